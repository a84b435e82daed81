#pragma once
// Plans executed by the host backend: arrays are copied there, the operation runs, the results are copied back.

#include "kernels/device.hpp"

#include <functional>
#include <memory>

namespace bromwich::cuda {

std::unique_ptr<LcpBatch> make_host_lcp(const Device&, Backend& host, const LcpMatrix&, LcpClass, double shift,
                                        Index rows);
std::unique_ptr<March> make_host_march(const Device&, Backend& host, const MarchProblem&, Index rows);

/// Copies between host values and an array of this backend. `meanwhile` runs during the copy.
void upload(const Device&, const RowMatrix& from, Array& to);
void download(const Device&, const Array& from, RowMatrix& to, const std::function<void()>& meanwhile = {});

}  // namespace bromwich::cuda
