#include "core/iteration/sweep_forecast.hpp"

#include "core/base/text.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index looked_at_every = 32;
constexpr double sweep_margin = 4;            ///< times the limit of sweeps: a forecast beyond this ends it
constexpr double falls = 0.9;                 ///< ratio of changes over half of the observed sweeps
constexpr double rounding_of_change = 1e-10;  ///< relative

}  // namespace

void SweepForecast::add(Index settled_rows, double change) {
  const double before = front_.empty() ? 0 : front_.back();
  front_.push_back(std::max(before, double(settled_rows)));  // it may decrease
  change_.push_back(change);
}

double SweepForecast::rows_a_sweep() const {
  const std::size_t half = front_.size() / 2;
  return (front_.back() - front_[half]) / double(front_.size() - 1 - half);
}

// Uses the smallest change of each half: changes may increase in single sweeps.
double SweepForecast::contraction() const {
  const auto middle = change_.begin() + std::ptrdiff_t(change_.size() / 2);
  const double early = *std::min_element(change_.begin(), middle), late = *std::min_element(middle, change_.end());
  return late < early ? std::pow(late / early, 2 / double(change_.size())) : 1;
}

std::optional<double> SweepForecast::sweeps_left() const {
  if (Index(front_.size()) < fewest_seen) return std::nullopt;
  const double speed = rows_a_sweep(), c = contraction(), rows = double(steps_ + 1) - front_.back();
  const double by_front = speed > 0 ? rows / speed : INFINITY;
  const double by_change = c < 1 ? std::max(0.0, std::log(tolerance_ / change_.back()) / std::log(c)) : INFINITY;
  return std::min(by_front, by_change);
}

std::optional<std::string> SweepForecast::hopeless() const {
  if (front_.size() % std::size_t(looked_at_every) != 0) return std::nullopt;
  const std::optional<double> left = sweeps_left();
  if (!left || !std::isfinite(*left)) return std::nullopt;  // if the front does not move its row is tested instead
  if (!(*left > sweep_margin * double(most_sweeps_))) return std::nullopt;
  const std::string seen = text(
      "after %ld sweeps %ld of %ld time points have settled, %.2g a sweep, and changes fall by "
      "a factor of %.3g a sweep",
      long(front_.size()), long(front_.back()), long(steps_ + 1), rows_a_sweep(), contraction());
  return seen + text(": about %.0e more would be needed; use method march", *left);
}

std::optional<bool> FrontRow::contracts(Index at, const Vector& y) {
  if (at != at_ || last_.size() != y.size()) {
    at_ = at;
    changes_.clear();
  } else {
    changes_.push_back((y - last_).cwiseAbs().maxCoeff() / std::max(1.0, y.cwiseAbs().maxCoeff()));
  }
  last_ = y;
  if (int(changes_.size()) < seen) return std::nullopt;
  const auto middle = changes_.begin() + seen / 2;
  const double early = *std::max_element(changes_.begin(), middle), late = *std::max_element(middle, changes_.end());
  const bool fall = late < falls * early || late <= rounding_of_change;
  if (fall) changes_.clear();
  return fall;
}

double FrontRow::factor() const {
  if (changes_.size() < 2 || !(changes_.front() > 0)) return 1;
  return std::pow(changes_.back() / changes_.front(), 1 / double(changes_.size() - 1));
}

}  // namespace bromwich
