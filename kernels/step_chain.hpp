#pragma once
// Shared by the chains of steps on the device.

#include "kernels/device.hpp"

#include "core/host/step_chain.hpp"

#include <memory>

namespace bromwich::cuda {

/// Sparse maps with up to this many states are converted to dense matrices. Sparse triangular solves along a chain have
/// one right-hand side at a time and no parallelism; products of dense maps have.
constexpr Index most_written_out = 384;

/// The part of a chain that does not depend on how maps are stored and multiplied. Rows are row vectors; device arrays
/// are (M+1) x m with the stride of DeviceArray. With the increment D of a step
///
///     forward    x_0 = d_0,  x_i = S_i^{-1} d_i + (I + D_i) x_{i-1}
///     backward   mu_M = q_M, mu_{i-1} = q_{i-1} + (I + D_i)^T mu_i,    l_i = S_i^{-T} mu_i
class DeviceStepChain : public StepChain {
 public:
  DeviceStepChain(const Device&, const StepChainProblem&);
  RowMatrix solve(RowMatrix d) final;
  RowMatrix solve_transposed(RowMatrix q, const AdjointChoice&) final;
  Vector weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) final;
  Vector locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                   const RowMatrix& l) final;

 protected:
  enum class Direction { forward, backward };

  /// x_i = S_i^{-1} d_i and l_i = S_i^{-T} mu_i for i >= 1; row 0 is copied.
  virtual void start(const double* d, double* x) = 0;
  virtual void finish(const double* mu, double* l) = 0;
  /// Solves the recurrence in place: step by step, or as a chunked scan.
  virtual void run(Direction, double* x) = 0;
  virtual void scan(Direction, double* x) = 0;
  virtual bool scan_is_faster() const = 0;
  virtual double scan_bytes() const = 0;
  /// next_i = mu_i + mu_{i+length} times the product of the `length` = 2^level maps between them, for i <= M - length.
  /// Also forms the products for the next level, if there is one.
  virtual void double_windows(int level, const double* mu, double* next) = 0;
  /// next_i = q_i + (I + D_{i+1})^T mu_{i+1}, next_M = q_M.
  virtual void carry(const double* q, const double* mu, double* next) = 0;
  /// r_i = d_i + (R_i - S_i) x_i - R_i (x_i - x_{i-1}); row 0 is not used.
  virtual void residual(const Array& d, const Array& x, Array& r) = 0;
  /// z_i = S_i^{-T} (q_i + R_{i+1}^T l_{i+1}): one block-Jacobi sweep from any l.
  virtual void sweep(const Array& q, const Array& l, Array& z) = 0;

  void copy_rows(const double* from, double* to, Index first, Index count) const;

  const Device& device_;
  int m_, M_;
  double memory_limit_;
  DeviceArray mu_, other_;

 private:
  void forward(const Array& d, Array& x);
  void adjoint(const Array& q, Array& l, const AdjointChoice&);
  bool scans() const { return scan_is_faster() && scan_bytes() <= memory_limit_; }
  const double* doubled();
  const double* swept(const double* q, Index sweeps);
};

/// Dense maps of any number of states (sparse ones are converted), with products by cuBLAS.
std::unique_ptr<StepChain> make_large_step_chain(const Device&, const StepChainProblem&);

}  // namespace bromwich::cuda
