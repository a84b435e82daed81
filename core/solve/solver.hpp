#pragma once

#include "../kernel/shared_dynamics.hpp"
#include "../result/inner_options.hpp"
#include "solve.hpp"
