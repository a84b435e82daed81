#pragma once
// The makers of each plan of this room.

#include "kernels/device.hpp"

#include <memory>

namespace bromwich::cuda {

std::unique_ptr<SineTransform> make_sine_transform(const Device&, Index n, Index rows);
std::unique_ptr<Convolution> make_scan(const Device&, const ModalRecurrence&, Index rows);
std::unique_ptr<Convolution> make_scan(const Device&, const DenseRecurrence&, Index rows);
std::unique_ptr<Convolution> make_fft_convolution(const Device&, const LagTable&, Index rows);
std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Device&, const Tridiagonal&, LcpClass, Index rows);
/// Null where the matrix is too large for these kernels.
std::unique_ptr<LcpBatch> make_dense_lcp(const Device&, const Matrix&, LcpClass, Index rows);

}  // namespace bromwich::cuda
