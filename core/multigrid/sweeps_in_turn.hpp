#pragma once
// The sweeps of a cycle, each with a divisor of its own (core/dual/sweep_choice.hpp): those before the coarse problem
// in order, and the last one after the correction.

#include "../seam/plans.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

/// Batches that take turns, from the first after `begin` to the last, which then stays.
class SweepsInTurn final : public LcpBatch {
 public:
  /// All at once or none.
  explicit SweepsInTurn(std::vector<std::unique_ptr<LcpBatch>> sweeps)
      : LcpBatch(sweeps.front()->at_once, sweeps.front()->recorded),
        sweeps_(std::move(sweeps)),
        next_(sweeps_.size() - 1) {
    if (std::all_of(sweeps_.begin(), sweeps_.end(), [](const auto& s) { return bool(s->submit_in_modes); }))
      submit_in_modes = [this](RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y,
                               Array* y_modes,
                               Index first) { take().submit_in_modes(S, r, v, v_in_modes, y, y_modes, first); };
  }

  /// The next sweep is the first one of a cycle.
  void begin() { next_ = 0; }

  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    take().submit(r, v, y, first, settle_tolerance);
  }
  LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    return sweeps_[last_]->finish(r, v, y, first, settle_tolerance);
  }
  LcpReport collect() override {
    LcpReport all;
    for (const auto& sweep : sweeps_) all.add(sweep->collect());
    return all;
  }
  double residual(const Array& r, const Array& v, const Array& y) override {
    return sweeps_.front()->residual(r, v, y);
  }
  std::size_t bytes() const override {
    std::size_t sum = 0;
    for (const auto& sweep : sweeps_) sum += sweep->bytes();
    return sum;
  }

 private:
  LcpBatch& take() {
    last_ = next_;
    next_ = std::min(next_ + 1, sweeps_.size() - 1);
    return *sweeps_[last_];
  }

  std::vector<std::unique_ptr<LcpBatch>> sweeps_;
  std::size_t next_, last_ = 0;  ///< last: submitted last
};

}  // namespace bromwich
