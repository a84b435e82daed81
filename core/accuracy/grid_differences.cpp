#include "core/accuracy/grid_differences.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double lowest_order = 0.5;  ///< that an estimate is made with; 1 where the differences scatter
const double scatter = std::sqrt(2);  ///< s
constexpr double abrupt = 100;        ///< factor that no order makes
constexpr double rounding_difference = 1e-11;

}  // namespace

void GridDifferences::limit_order(double order) { highest_ = std::min(highest_, order); }

// d_k, and d_{k-1} / 2^q if that is larger.
double GridDifferences::believed(std::size_t k) const {
  return k == 0 ? differences_[0] : std::max(differences_[k], differences_[k - 1] * std::exp2(-highest_));
}

double GridDifferences::order() const {
  const std::size_t n = differences_.size();
  if (n < 2) return NAN;
  const double halvings = n == 2 ? 1 : 2, first = differences_[n == 2 ? 0 : n - 3], last = differences_[n - 1];
  if (!std::isfinite(first) || !std::isfinite(last)) return lowest_order;
  if (last == 0) return highest_;
  const double lowest = n > 2 && !regular() ? std::min(1.0, highest_) : lowest_order;
  const double p = std::clamp(std::log2(first / last) / halvings, lowest, highest_);
  return std::exp2(highest_) - 1 <= scatter * (std::exp2(p) - 1) ? highest_ : p;
}

double GridDifferences::observed_order() const {
  const std::size_t n = differences_.size();
  if (n < 3) return NAN;
  const double first = differences_[n - 3], last = differences_[n - 1];
  return last > rounding_difference && std::isfinite(first) ? std::log2(first / last) / 2 : NAN;
}

double GridDifferences::error(bool checked) const {
  const std::size_t n = differences_.size();
  if (n < 2) return NAN;
  const double p = order(), last = differences_[n - 1];
  const double smoothed = n == 2 ? last : std::cbrt(differences_[n - 3] * differences_[n - 2] * last) * std::exp2(-p);
  const double d = checked ? std::sqrt(last * std::max(last, smoothed)) : std::max(believed(n - 1), smoothed);
  return d / (std::exp2(p) - 1);
}

double GridDifferences::error_from_check(double d) const { return d * std::pow(0.75, order()); }

bool GridDifferences::negligible(double goal) const {
  return confirmed() && *std::max_element(differences_.end() - 3, differences_.end()) <= 0.01 * goal;
}

bool GridDifferences::regular() const {
  const std::size_t n = differences_.size();
  if (n < 3 || differences_[n - 1] == 0) return false;
  const double before = differences_[n - 3] / differences_[n - 2], now = differences_[n - 2] / differences_[n - 1];
  return std::abs(std::log2(before / now)) <= 0.25;
}

bool GridDifferences::changes_abruptly() const {
  const std::size_t n = differences_.size();
  if (n < 2) return false;
  const auto [smaller, larger] = std::minmax(differences_[n - 2], differences_[n - 1]);
  return larger > std::max(abrupt * smaller, rounding_difference);
}

bool GridDifferences::stands_still() const {
  const std::size_t n = differences_.size();
  return n >= 3 && believed(n - 1) > 0.5 * believed(n - 3);
}

bool GridDifferences::stalled(std::size_t window) const {
  if (differences_.size() < 2 * window) return false;
  const auto middle = differences_.end() - std::ptrdiff_t(window);
  return *std::min_element(middle, differences_.end()) >
         0.5 * *std::min_element(middle - std::ptrdiff_t(window), middle);
}

double GridDifferences::largest_recent() const {
  const std::size_t n = differences_.size();
  double largest = 0;
  for (std::size_t back = 0; back < std::min<std::size_t>(n, 2); ++back)
    largest = std::max(largest, std::ldexp(differences_[n - 1 - back], -int(back)));
  return largest;
}

double GridDifferences::halvings_to(double tolerance) const {
  return std::max(0.0, std::log2(error() / tolerance) / order());
}

double GridDifferences::fewest_halvings_to(double tolerance) const {
  return std::max(0.0, std::log2(error() / tolerance) / std::max(order(), std::min(1.0, highest_)));
}

}  // namespace bromwich
