#pragma once
// What all step-by-step methods share: y_0, and the words and numbers of a result.

#include "../kernel/discrete_problem.hpp"
#include "../result/result.hpp"

namespace bromwich {

enum class Start {
  found,    ///< y_0 in SOL(M, N x0 + g(0))
  impulse,  ///< there is none, but M is singular: y may act as an impulse that moves the state at t = 0
  none,     ///< there is none, and the result says so
};

/// Sizes result.y, all NaN but y_0 in row 0 where `found`.
Start solve_at_zero(const DiscreteProblem&, Result&);

/// The complementarity problem at t = 0, prepared. Keeps the discrete problem.
class ProblemAtZero {
 public:
  explicit ProblemAtZero(const DiscreteProblem&);
  /// For another x0 and g(0).
  void renew();
  /// y_0 alone; result.y is left as it is.
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

/// The natural-map residual of y with q = r + v. Without y_0, row 0 (an impulse) is left out.
double march_residual(const DiscreteProblem&, Start, const Array& r, const Array& v, const Array& y);

inline constexpr const char* impulse_note = "; x0 violates the constraints: the state jumps at t = 0";

}  // namespace bromwich
