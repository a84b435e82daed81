#include "core/result/time_left.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr std::size_t most_sweeps = 9;  ///< in the mean of the contraction: changes of single sweeps go up and down

}  // namespace

std::optional<double> TimeLeft::steps_left(const Progress& p) const {
  if (p.total > 0) return double(std::max<Index>(0, p.total - p.iteration));
  if (sweeps_.size() < 2) return std::nullopt;
  if (p.change <= tolerance_) return 0;
  const Sweep& before = sweeps_.front();
  const double factor = std::pow(p.change / before.change, 1 / double(p.iteration - before.iteration));
  if (!(factor > 0) || !(factor < 1)) return std::nullopt;
  return std::log(tolerance_ / p.change) / std::log(factor);
}

std::optional<double> TimeLeft::after(const Progress& p, double seconds) {
  if (!begun_ || p.total != last_.total || p.iteration < last_.iteration) {
    begun_ = true;
    first_ = p;
    since_ = seconds;
    sweeps_.clear();
  }
  last_ = p;
  if (p.total == 0 && (sweeps_.empty() || p.iteration > sweeps_.back().iteration)) {
    sweeps_.push_back({p.iteration, p.change});
    if (sweeps_.size() > most_sweeps) sweeps_.erase(sweeps_.begin());
  }
  const Index done = p.iteration - first_.iteration;
  const std::optional<double> left = steps_left(p);
  if (done == 0 || !left) return std::nullopt;
  return *left * (seconds - since_) / double(done);
}

}  // namespace bromwich
