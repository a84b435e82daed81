#pragma once
// The functional iteration (2.17) of the Laplace-inversion paper on all time points at once:
//
//     y^{k+1}_j in SOL(M, r_j + (K * y^k)_j),   j = 0..J,   from x^0(t) = x0.
//
// symbol  variable    shape        meaning
// K *     SpaceTimeKernel          discrete causal convolution, in sine modes where they diagonalise it
// r       r           (J+1) x n    what does not depend on y
// v       v           (J+1) x n    K * y

#include "../kernel/prepared_method.hpp"
#include "../kernel/time_operator.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Its run fills status, y, iterations, history, counters, residual and seconds of a result.
std::unique_ptr<PreparedMethod> prepare_iteration(TimeOperator&, const Options&);

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
