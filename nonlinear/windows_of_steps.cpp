#include "nonlinear/windows_of_steps.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double largest_contraction = 0.7;   ///< above: shorter windows
constexpr Index looked_at = 4;                ///< iterations before the contraction counts
constexpr double rounding_of_windows = 1e-8;  ///< changes below that no longer halve are rounding

double relative_change(const RowMatrix& now, const RowMatrix& before) {
  if (now.size() == 0) return 0;
  const double most = (now - before).cwiseAbs().maxCoeff();
  return most > 0 ? most / (now.cwiseAbs().maxCoeff() + most) : 0;
}

}  // namespace

double apart(const WindowsOfSteps::Rows& a, const WindowsOfSteps::Rows& b) {
  return std::max(relative_change(a.seen, b.seen), relative_change(a.y, b.y));
}

ContractionWatch::Verdict ContractionWatch::after(double change) {
  const Index k = ++changes_;
  const double before = before_;
  before_ = change;
  if (k > 1 && before > 0) {
    last_ = change / before;
    if (change > 100 * tolerance_) contraction_ = std::max(k > 2 ? contraction_ : 0, last_);
    if (k > looked_at && last_ > largest_contraction && change > rounding_of_windows) return Verdict::too_slow;
  }
  // What the iterations to come change.
  const double left = change * contraction_ / (1 - std::min(contraction_, 0.9));
  const bool rounding = k > 1 && change <= rounding_of_windows && change > before / 2;
  return change <= tolerance_ || (k > 2 && left <= 0.1 * tolerance_) || rounding ? Verdict::converged : Verdict::go_on;
}

}  // namespace bromwich
