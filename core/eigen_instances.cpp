#define BROMWICH_EIGEN_INSTANCE template
#include "core/eigen_instances.hpp"
