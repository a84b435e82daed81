#pragma once

#include "core/base/simd.hpp"

namespace bromwich::cpu {

using namespace simd;

}  // namespace bromwich::cpu
