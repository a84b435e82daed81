#pragma once
// What the chains of steps of this room share.

#include "kernels/device.hpp"

#include "core/step_chain.hpp"

#include <memory>

namespace bromwich::cuda {

/// Sparse maps of up to so many states are written out as dense matrices: a chain of sparse triangular solves has one
/// right-hand side at a time and nothing to do at once, products of dense maps do.
constexpr Index most_written_out = 384;

/// What is asked for by matrices of the host, from operations on arrays of the device.
class DeviceStepChain : public StepChain {
 public:
  explicit DeviceStepChain(const Device& device) : device_(device) {}
  RowMatrix solve(RowMatrix d) final;
  RowMatrix solve_transposed(RowMatrix q, const AdjointChoice&) final;
  Vector weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) final;
  Vector locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                   const RowMatrix& l) final;

 protected:
  /// r_i = d_i + (R_i - S_i) x_i - R_i (x_i - x_{i-1}); row 0 is not used.
  virtual void residual(const Array& d, const Array& x, Array& r) = 0;
  /// z_i = S_i^{-T} (q_i + R_{i+1}^T l_{i+1}): a sweep of block-Jacobi from any l.
  virtual void sweep(const Array& q, const Array& l, Array& z) = 0;

  const Device& device_;
};

/// Maps of any number of states, written out, with products by cuBLAS.
std::unique_ptr<StepChain> make_large_step_chain(const Device&, const StepChainProblem&);

}  // namespace bromwich::cuda
