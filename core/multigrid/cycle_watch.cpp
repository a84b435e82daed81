#include "core/multigrid/cycle_watch.hpp"

#include "core/base/text.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr double slow = 0.5;                ///< contraction of a cycle that is too slow
constexpr double unseen = 0.1;              ///< smallest contraction assumed for further cycles after the first
constexpr double rounding_changes = 1e-10;  ///< changes that may be due to rounding

}  // namespace

std::optional<IterationOutcome> CycleWatch::after(double change) {
  if (!std::isfinite(change)) return IterationOutcome{Status::nonfinite, "the iterates grew beyond all bounds"};
  const bool seen = change_ > 0;
  const double contraction = seen ? change / change_ : contraction_;
  worst_ = std::max(contraction, contraction_);
  slow_ = seen && contraction > slow ? slow_ + 1 : 0;
  change_ = change;
  seen_ = seen;
  contraction_ = seen ? contraction : std::max(contraction, unseen);
  if (change <= tolerance_ || (seen && left() <= tolerance_) || (slow_ > 0 && change <= rounding_changes))
    return IterationOutcome{Status::solved, ""};
  if (slow_ >= 2 || ++cycles_ >= most_cycles)
    return IterationOutcome{Status::tolerance_not_met,
                            text("the cycles do not contract: change %.2e in the last, %.2f of that before; use "
                                 "method march or more steps",
                                 change, contraction)};
  return std::nullopt;
}

double CycleWatch::left() const { return worst_ < slow ? change_ * worst_ / (1 - worst_) : INFINITY; }

void CycleWatch::restart() {
  change_ = 0;
  slow_ = 0;
  seen_ = false;
  contraction_ = worst_ = INFINITY;
}

}  // namespace bromwich
