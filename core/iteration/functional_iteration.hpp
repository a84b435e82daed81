#pragma once
// The functional iteration (2.17) of the Laplace-inversion paper on all time points at once:
//
//     y^{k+1}_j in SOL(M, r_j + (K * y^k)_j),   j = 0..J,   from x^0(t) = x0.
//
// symbol  variable    shape        meaning
// K *     SpaceTimeKernel          discrete causal convolution, in sine modes where they diagonalise it
// r       r           (J+1) x n    terms without y
// v       v           (J+1) x n    K * y

#include "../kernel/prepared_method.hpp"
#include "../kernel/time_operator.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Running it sets status, y, iterations, history, counters, residual and seconds of a result.
std::unique_ptr<PreparedMethod> prepare_iteration(TimeOperator&, const Options&);

/// The loop for any kernel: `apply(y, v, first)` evaluates K * y. `recordable`: apply uses operations of the backend
/// only, which may be recorded. `start`: q of the first batch, N x0 + g; null: it is made of the samples of g.
struct IterationOutcome {
  Status status = Status::tolerance_not_met;
  std::string reason;
  Index infeasible = -1;  ///< row of an iterate that stayed infeasible; not a proof for the scene
  Index settled = 0;      ///< rows before it had settled
};
using ApplyKernel = std::function<void(const Array& y, Array& v, Index first)>;
IterationOutcome iterate(const DiscreteProblem&, const Options&, const ApplyKernel&, bool recordable, LcpBatch&,
                         const Array& r, Array& y, Array& v, Result& result, const Array* start = nullptr);

/// Writes y, the trace, status and the residual of a fresh K * y to `result`. Rows that had not settled when an
/// iteration was stopped become NaN.
void finish_iteration(const DiscreteProblem&, const Options&, const IterationOutcome&, const ApplyKernel&, LcpBatch&,
                      const Array& r, const Array& y, Array& v, Result& result);

}  // namespace bromwich
