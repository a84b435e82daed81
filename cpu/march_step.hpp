#pragma once
// What a march solves in a step: a complementarity problem, or a linear one (core/seam/linear_march.hpp).

#include "core/host/step_lcp.hpp"
#include "core/seam/linear_march.hpp"

#include <optional>

namespace bromwich::cpu {

class MarchStep {
 public:
  /// `linear`: empty for a complementarity problem with the matrix that `implicit` returns, M + W_0.
  template <class Implicit>
  MarchStep(const MarchProblem& problem, const LinearStep& linear, const Matrix& M, const Implicit& implicit)
      : linear_(linear) {
    if (!linear_) lcp_.emplace(implicit(), M, problem.lcp_class);
  }

  bool well_posed() const { return !lcp_ || lcp_->well_posed(); }
  void start_from(const Vector& y) {
    if (lcp_) lcp_->start_from(y);
  }
  // As StepLcp::solve. Precondition: y has n entries.
  bool solve(const Vector& q, Vector& y, Index j, MarchReport& report) {
    if (lcp_) return lcp_->solve(q, y, j, report);
    linear_(j, q, y);
    ++report.count.solved;
    return true;
  }
  /// (M + W_0) y of the last solution, n entries; null if it was not computed.
  const double* product() const { return lcp_ ? lcp_->product() : nullptr; }
  std::size_t bytes() const { return lcp_ ? lcp_->bytes() : 0; }

 private:
  LinearStep linear_;
  std::optional<host::StepLcp> lcp_;
};

}  // namespace bromwich::cpu
