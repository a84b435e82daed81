#define BROMWICH_EIGEN_INSTANCE template
#include "core/base/eigen_instances.hpp"
