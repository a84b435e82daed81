#pragma once

#include "../core/scene/natural_units.hpp"
#include "solution_derivative.hpp"
