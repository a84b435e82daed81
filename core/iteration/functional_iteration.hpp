#pragma once
// The functional iteration (2.17) of the Laplace-inversion paper on all time points at once:
//
//     y^{k+1}_j in SOL(M, r_j + (K * y^k)_j),   j = 0..J,   from x^0(t) = x0.
//
// symbol  variable    shape        meaning
// K *     SpaceTimeKernel          discrete causal convolution, in sine modes where they diagonalise it
// r       r           (J+1) x n    what does not depend on y
// v       v           (J+1) x n    K * y

#include "../kernel/discrete_problem.hpp"
#include "../kernel/sparse_kernel.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Sweeps of the iteration in turn; v <- K y comes between them, and before the first and behind the last as said here.
struct SweepOrder {
  int count = 1;
  bool before = false, behind = false;
};

/// v = K * y: S (modal convolution) S for the Kronecker sum, one convolution otherwise. Counts its seconds.
class SpaceTimeKernel {
 public:
  SpaceTimeKernel(Backend&, std::unique_ptr<Convolution>, bool modal, Index rows, Index n);

  void apply(const Array& y, Array& v, Index first);
  /// The same for y = R y_fine on the grid with half the steps, y_fine what `fine` was last applied to: its modes are
  /// known.
  void apply_injected(const SpaceTimeKernel& fine, const Array& y_fine, Array& y, Array& v);
  /// For a Kronecker sum, where the modes of what `fine` was last applied to are all that is needed.
  void apply_injected_modes(const SpaceTimeKernel& fine, Array& v);
  /// Whether `sweep` is there for batches of this plan.
  bool sweeps(const LcpBatch&) const;
  /// y <- SOL(M + D, r + v - D y) from row 1 on, `count` times, with v <- K y between them and where `order` says so.
  /// If there is none before the first, v has to be K y, and the kernel applied to a y with this row 0 last. v is K y
  /// then if there is one behind the last, otherwise as it was: from sweep to sweep it stays in modes.
  void sweep(LcpBatch&, const Array& r, Array& y, Array& v, SweepOrder order);
  /// r <- r + what x0 adds by itself, for a Kronecker sum: the recurrence of the kernel with x0 in its start, applied
  /// to `zero`.
  void add_start(const Recurrence& started, const Array& zero, Array& r);
  std::size_t bytes() const;

  double transform_seconds = 0, convolution_seconds = 0;

 private:
  Backend& backend_;
  std::unique_ptr<Convolution> convolution_;
  std::unique_ptr<SineTransform> sine_;
  std::unique_ptr<Array> y_modes_, v_modes_;
};

/// How a kernel was made.
struct KernelChoice {
  std::unique_ptr<SpaceTimeKernel> kernel;
  std::string description;
  double error = 0;  ///< see Result::kernel_error
  /// The recurrence of the kernel with x0 in its start; none: the response to x0 is a table over time.
  std::optional<Recurrence> started = {};
};

/// The kernel by recurrence (scan) or lag table (FFT), from contours where the spectrum allows one.
KernelChoice make_kernel(const DiscreteProblem&, ConvolutionChoice);

/// One step of the state costs less than its share of transforms over time (dense dynamics).
bool scan_is_cheaper(const DiscreteProblem&);

/// r on the backend: g + N e^{At} x0 + response to f. `work` is one array of its shape; where f = B phi in a Kronecker
/// sum it is left with K phi, and the kernel has been applied to phi last. Dense dynamics and Kronecker sums.
std::unique_ptr<Array> make_response(const DiscreteProblem&, KernelChoice&, Array& work);

/// Fills status, y, iterations, history, counters, residual and seconds of `result`.
void solve_by_iteration(const DiscreteProblem&, const Options&, Result& result);
/// The same with the kernel of sparse dynamics.
void solve_by_iteration(const DiscreteProblem&, const SparseKernel&, const Options&, Result& result);

/// The loop itself, for kernels that are not a SpaceTimeKernel too: `apply(y, v, first)` evaluates K * y. `recordable`:
/// it does so by operations of the backend alone, which may be recorded.
struct IterationOutcome {
  Status status = Status::tolerance_not_met;
  std::string reason;
  Index infeasible = -1;  ///< row of an iterate that stayed infeasible: not yet a proof for the scene
  Index settled = 0;      ///< rows before it had settled
};
using ApplyKernel = std::function<void(const Array& y, Array& v, Index first)>;
IterationOutcome iterate(const DiscreteProblem&, const Options&, const ApplyKernel&, bool recordable, LcpBatch&,
                         const Array& r, Array& y, Array& v, Result& result);

/// Writes y, the trace, status and the residual of a fresh K * y to `result`; rows that had not settled in an iteration
/// that was cut off become NaN.
void finish_iteration(const DiscreteProblem&, const Options&, const IterationOutcome&, const ApplyKernel&, LcpBatch&,
                      const Array& r, const Array& y, Array& v, Result& result);

}  // namespace bromwich
