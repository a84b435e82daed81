#pragma once

#include "bromwich/dynamics.hpp"
#include "grid_system.hpp"
#include "linear_system.hpp"
