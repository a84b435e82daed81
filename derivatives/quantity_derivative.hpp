#pragma once

#include "../core/goal/quantities.hpp"
#include "solution_derivative.hpp"
