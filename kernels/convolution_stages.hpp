#pragma once

#include "kernels/device.hpp"

#include <memory>

namespace bromwich::cuda {

/// A scan of both stages with a common state. Null for more exponentials than a block holds.
std::unique_ptr<Convolution> make_stage_scan(const Device&, const StageRecurrence&, Index rows);

}  // namespace bromwich::cuda
