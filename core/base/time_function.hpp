#pragma once

#include "bromwich/time_function.hpp"
#include "types.hpp"
