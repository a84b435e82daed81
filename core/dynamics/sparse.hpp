#pragma once

#include "bromwich/dynamics.hpp"
#include "linear_system.hpp"
