#include "core/result/switching.hpp"
#include "core/result/located.hpp"
#include "core/result/located_solution.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <utility>

namespace bromwich {

namespace {

struct Value {
  double t, y;
};
struct Root {
  double t, error;
};
/// Where the line through `nearest` and `next` vanishes, and what the curvature up to `last` says of its error; all
/// three are on the active side. Empty if it is outside the step [begin, end], by more than the part `beyond` of it.
std::optional<Root> root(Value nearest, Value next, Value last, double begin, double end, double beyond = 0) {
  const double slope = (next.y - nearest.y) / (next.t - nearest.t), t = nearest.t - nearest.y / slope;
  const double h = end - begin;
  if (!(t >= begin - beyond * h) || !(t <= end + beyond * h)) return std::nullopt;
  // Remainder of the linear continuation, (t - t_0)(t - t_1) times the second divided difference, over the slope.
  const double curvature = ((last.y - next.y) / (last.t - next.t) - slope) / (last.t - nearest.t);
  const double error = std::abs((t - nearest.t) * (t - next.t) * curvature / slope);
  return Root{t, std::isnan(error) ? h / 2 : std::min(error, h / 2)};
}

// Discontinuous y: extrapolates from the interval next to step j that is active throughout. The step itself may be
// active in part, so its y is not used.
Switch by_line(const Solution& r, Index j, Index i, bool on, double zero) {
  constexpr double beyond = 0.1;  // of a step: y is known to O(h^2), and so are its roots
  const Index N = r.y_left.rows();
  const auto active = [&](Index k) { return k >= 0 && k < N && r.y_left(k, i) > zero && r.y(k + 1, i) > zero; };
  const double middle = (r.t[j] + r.t[j + 1]) / 2, half = (r.t[j + 1] - r.t[j]) / 2;
  const Index k = !on ? j - 1 : active(j) ? j : j + 1, farther = on ? k + 1 : k - 1;
  if (!active(k)) return {middle, i, on, half};
  const Value left{r.t[k], r.y_left(k, i)}, right{r.t[k + 1], r.y(k + 1, i)};
  const Value last = !active(farther) ? Value{NAN, NAN}
                     : on             ? Value{r.t[k + 2], r.y(k + 2, i)}
                                      : Value{r.t[farther], r.y_left(farther, i)};
  const double begin = on ? r.t[k] - (r.t[k + 1] - r.t[k]) : r.t[k + 1];
  const double end = on ? r.t[k] : r.t[k + 1] + (r.t[k + 1] - r.t[k]);
  const std::optional<Root> found =
      on ? root(left, right, last, begin, end, beyond) : root(right, left, last, begin, end, beyond);
  return found ? Switch{found->t, i, on, found->error} : Switch{middle, i, on, half};
}

}  // namespace

std::vector<Switch> switches(const Solution& s, double negligible) {
  if (s.located) return s.located->switches;
  const RowMatrix& y = s.y;
  Index rows = 0;
  while (rows < y.rows() && (rows == 0 || y.row(rows).allFinite())) ++rows;
  const Index first = rows > 0 && y.row(0).allFinite() ? 0 : 1;
  std::vector<Switch> found;
  if (rows - first < 2 || y.cols() == 0) return found;
  const double zero = negligible * y.middleRows(first, rows - first).cwiseAbs().maxCoeff();
  for (Index j = first; j + 1 < rows; ++j) {
    for (Index i = 0; i < y.cols(); ++i) {
      const bool before = y(j, i) > zero, on = y(j + 1, i) > zero;
      if (before == on) continue;
      if (s.y_left.size() > 0) {
        found.push_back(by_line(s, j, i, on, zero));
        continue;
      }
      // Rows of the active side, away from the step; rows where y vanishes again are not used.
      const Index start = on ? j + 1 : j, direction = on ? 1 : -1;
      const auto value = [&](Index steps) {
        const Index row = start + direction * steps;
        return row >= first && row < rows && y(row, i) > zero ? Value{s.t[row], y(row, i)} : Value{NAN, NAN};
      };
      const std::optional<Root> r = root(value(0), value(1), value(2), s.t[j], s.t[j + 1]);
      const double half = (s.t[j + 1] - s.t[j]) / 2;
      found.push_back(r ? Switch{r->t, i, on, r->error} : Switch{s.t[j] + half, i, on, half});
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const Switch& a, const Switch& b) { return a.t < b.t; });
  return found;
}

std::vector<double> distances(const std::vector<Switch>& found, const std::vector<Switch>& other, double none) {
  std::map<std::pair<Index, bool>, std::vector<double>> times;  // of each kind
  for (const Switch& o : other) times[{o.component, o.on}].push_back(o.t);
  for (auto& [kind, of_kind] : times) std::sort(of_kind.begin(), of_kind.end());
  std::vector<double> apart;
  for (const Switch& s : found) {
    const std::vector<double>& same = times[{s.component, s.on}];
    const auto next = std::lower_bound(same.begin(), same.end(), s.t);
    double nearest = INFINITY;
    if (next != same.end()) nearest = *next - s.t;
    if (next != same.begin()) nearest = std::min(nearest, s.t - *std::prev(next));
    apart.push_back(same.empty() ? none : nearest);
  }
  return apart;
}

std::vector<RelaySwitch> relay_switches(const Result& result, const std::vector<Switch>& found, Index relays) {
  std::vector<RelaySwitch> all;
  const auto lambda = [](bool s, bool y) { return y ? -1 : s ? 0 : 1; };
  for (Index relay = 0; relay < relays; ++relay) {
    std::vector<Switch> own;
    for (const Switch& s : found)
      if (s.component < 2 * relays && s.component % relays == relay) own.push_back(s);
    // Without a switch y is positive at all times or never: any row says so, but y_0 may be undetermined.
    const auto before = [&](Index component) {
      for (const Switch& s : own)
        if (s.component == component) return !s.on;
      return result.y.rows() > 1 && result.y(1, component) > 0;
    };
    bool s = before(relay), y = before(relay + relays);
    for (std::size_t k = 0; k < own.size();) {
      const int from = lambda(s, y);
      double last = own[k].t, sum = 0, error = 0;
      const std::size_t first = k;
      for (; k < own.size(); ++k) {
        const bool located = locates_switches(result);
        const double step = result.steps > 0 && !located ? result.t[result.t.size() - 1] / double(result.steps) : 0;
        if (k > first && own[k].t - last > std::max(step, own[k].error)) break;
        (own[k].component < relays ? s : y) = own[k].on;
        last = own[k].t;
        sum += last;
        error = std::max(error, own[k].error);
      }
      const double mean = sum / double(k - first);
      if (const int to = lambda(s, y); to != from)
        all.push_back({mean, relay, from, to, std::max(error, std::max(last - mean, mean - own[first].t))});
    }
  }
  std::stable_sort(all.begin(), all.end(), [](const RelaySwitch& a, const RelaySwitch& b) { return a.t < b.t; });
  return all;
}

}  // namespace bromwich
