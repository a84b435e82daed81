#pragma once
// One matrix of complementarity problems: what a vector is worth as a solution, and single solves.

#include "bromwich/lcp_batch.hpp"
#include "core/lcp/active_set.hpp"

#include <optional>

namespace bromwich {

class CheckedLcp {
 public:
  /// The class is that of the caller, or a quick guess: M of other classes than the exact tests find in little time
  /// count as unknown.
  CheckedLcp(const LcpMatrix& M, LcpClass);

  Index size() const { return scale_.rows.size(); }
  LcpClass lcp_class() const { return class_; }

  struct Verdict {
    bool solution = false;
    double residual = 0, margin = 0;
  };
  /// y >= 0 and min(y, w) = 0 to rounding; w = M y + q, 0 where y > 0. Any number of threads may ask.
  Verdict judge(const Vector& q, const Vector& y, Vector& w, SlackTerms& scratch) const;

  /// By active sets, from {start > 0}, with the fallbacks of the class.
  LcpStatus solve(const Vector& q, const Vector& start, Vector& y, Index& iterations);

 private:
  LcpStatus without_solution(const LcpOutcome&, const Vector& q) const;

  Equilibration scale_;
  LcpClass class_;
  Matrix dense_;                        ///< R M C of a dense matrix; otherwise empty
  std::optional<SparseMatrix> sparse_;  ///< R M C of others
  Matrix original_;                     ///< for single solves; of others than dense ones made by the first
  LcpMatrix given_;
  std::optional<ActiveSetLcp> solver_;
};

/// The class if it is found in O(n^3): that of `classify`, whose exact test of P is left out above n = 8.
LcpClass quick_class(const Matrix& M);

}  // namespace bromwich
