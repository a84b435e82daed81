#pragma once

#include "../base/types.hpp"
#include "array.hpp"
#include "bromwich/ranks.hpp"
