#pragma once
// Shared by all step-by-step methods: y_0, and status, reason and counters of a result.

#include "../kernel/discrete_problem.hpp"
#include "../result/result.hpp"
#include "../scan/chunk_scan.hpp"

namespace bromwich {

enum class Start {
  found,    ///< y_0 in SOL(M, N x0 + g(0))
  impulse,  ///< no solution, but M is singular: y may act as an impulse that moves the state at t = 0
  none,     ///< no solution; the result says so
};

/// Sizes result.y, fills it with NaN, and sets row 0 to y_0 if `found`.
Start solve_at_zero(const DiscreteProblem&, Result&);

/// Whether w_i < 0 at t = 0 for a constraint that no impulse of y moves, since its rows of M and of N B are zero: a
/// body below a rigid floor, whose impulses move the velocity alone. The result then says so. start: w with y = 0, n
/// values.
bool starts_below(const Scene&, const Vector& start, Result&);

/// Whether M leaves room for an impulse of y that moves the state, where the problem of an instant has no solution.
bool may_have_impulse(const DiscreteProblem&);

/// The prepared complementarity problem at t = 0. Refers to the discrete problem.
class ProblemAtZero {
 public:
  explicit ProblemAtZero(const DiscreteProblem&);
  /// Updates for another x0 and g(0).
  void renew();
  /// y_0 alone; does not change result.y.
  Start solve(Result&, Vector& y0) const;

 private:
  const DiscreteProblem& p_;
  std::unique_ptr<Array> r_, v_, y_;
  std::unique_ptr<LcpBatch> lcp_;
};

/// Status, reason and time of a march that stopped before T.
void explain_stop(const DiscreteProblem&, const MarchReport&, Result&);

/// Adds the counters of a march to the result.
void count(const MarchReport&, Result&);

/// What a march by chunks took: Result::iterations, history, and words behind Result::kernel.
void tell(const ScanReport&, Result&);

/// Natural-map residual of y with q = r + v. Without y_0 (an impulse), row 0 is skipped.
double march_residual(const DiscreteProblem&, Start, const Array& r, const Array& v, const Array& y);

inline constexpr const char* impulse_note = "; x0 violates the constraints: the state jumps at t = 0";

}  // namespace bromwich
