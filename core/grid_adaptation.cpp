#include "core/grid_adaptation.hpp"

#include "core/text.hpp"
#include "core/timer.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace bromwich {
namespace {

constexpr Index largest_grid = Index(1) << 22;
constexpr Index most_refinements = 1000;

GoalCycle record(const GoalEvaluation& e, std::optional<double> exact) {
  GoalCycle cycle;
  cycle.cells = e.indicators.size();
  cycle.sizes = e.sizes;
  cycle.quantity = e.quantity;
  cycle.estimate = e.indicators.sum();
  cycle.absolute = e.indicators.cwiseAbs().sum();
  if (exact && e.quantity != *exact) cycle.effectivity = cycle.estimate / (e.quantity - *exact);
  return cycle;
}

}  // namespace

Vector first_grid(double T, Index cells, const std::vector<double>& breaks) {
  std::vector<double> t;
  for (Index i = 0; i <= cells; ++i) t.push_back(i == cells ? T : T * double(i) / double(cells));
  for (const double s : breaks) {
    const auto nearest =
        std::min_element(t.begin(), t.end(), [s](double a, double b) { return std::abs(a - s) < std::abs(b - s); });
    // A point that rounding alone keeps from the break moves there.
    if (std::abs(*nearest - s) > 16 * epsilon * T)
      t.push_back(s);
    else if (*nearest > 0 && *nearest < T)
      *nearest = s;
  }
  std::sort(t.begin(), t.end());
  return Eigen::Map<const Vector>(t.data(), Index(t.size()));
}

namespace {

/// Cells by decreasing size.
std::vector<Index> by_size(const Vector& size) {
  std::vector<Index> cells(std::size_t(size.size()));
  std::iota(cells.begin(), cells.end(), Index(0));
  std::stable_sort(cells.begin(), cells.end(), [&](Index a, Index b) { return size[a] > size[b]; });
  return cells;
}

}  // namespace

std::vector<Index> marked_cells(const Vector& indicators, double marking, Index most) {
  const Vector size = indicators.cwiseAbs();
  std::vector<Index> cells = by_size(size);
  const double wanted = marking * size.sum();
  double covered = 0;
  std::size_t count = 0;
  while (count < cells.size() && Index(count) < most && covered < wanted && size[cells[count]] > 0)
    covered += size[cells[count++]];
  cells.resize(count);
  std::sort(cells.begin(), cells.end());
  return cells;
}

std::vector<Index> economical_cells(const Vector& indicators, int q, Index most) {
  const Vector size = indicators.cwiseAbs();
  std::vector<Index> cells = by_size(size);
  const double gain = 1 - std::exp2(-q);
  double left = size.sum(), least = INFINITY;
  Index best = 0;
  for (Index count = 1; count <= size.size() && size[cells[std::size_t(count - 1)]] > 0; ++count) {
    left -= gain * size[cells[std::size_t(count - 1)]];
    const double cost = left * std::pow(1 + double(count) / double(size.size()), q);
    if (cost >= least) continue;
    least = cost;
    best = count;
  }
  cells.resize(std::size_t(std::min(best, most)));
  std::sort(cells.begin(), cells.end());
  return cells;
}

Vector bisected(const Vector& t, const std::vector<Index>& marked) {
  std::vector<double> points;
  points.reserve(std::size_t(t.size()) + marked.size());
  const double shortest = 64 * epsilon * t[t.size() - 1];
  auto next = marked.begin();
  for (Index i = 0; i < t.size(); ++i) {
    points.push_back(t[i]);
    if (next == marked.end() || *next != i) continue;
    ++next;
    const double h = t[i + 1] - t[i];
    if (h > shortest) points.push_back(t[i] + h / 2);
  }
  return Eigen::Map<const Vector>(points.data(), Index(points.size()));
}

AdaptedGrid adapt_grid(Vector t, const Options& options, const GoalOptions& goal, const QuantityOfInterest& quantity,
                       Index default_cells, const std::function<GoalEvaluation(const Vector& t)>& evaluate) {
  const bool open_ended = goal.cycles > 0 || options.tolerance > 0;
  const Index limit = options.steps > 0 ? options.steps : open_ended ? largest_grid : default_cells;
  const Index cycles = goal.cycles > 0 ? goal.cycles : most_refinements;
  const std::optional<double> exact = quantity.exact();
  const int q = quantity.order(order(goal.scheme));
  AdaptedGrid grid;
  Timer timer;
  for (grid.t = std::move(t);;) {
    grid.last = evaluate(grid.t);
    GoalCycle cycle = record(grid.last, exact);
    cycle.seconds = timer.lap();
    grid.history.push_back(cycle);
    if (options.progress) options.progress({Index(grid.history.size()), cycle.estimate, limit});
    if (!std::isfinite(cycle.quantity) || !std::isfinite(cycle.absolute)) {
      grid.status = Status::nonfinite;
      grid.reason = text("the quantity or its estimate is not finite on %td cells", cycle.cells);
      return grid;
    }
    const bool reached = options.tolerance > 0 && std::abs(cycle.estimate) <= options.tolerance &&
                         (!exact || std::abs(cycle.quantity - *exact) <= options.tolerance);
    if (reached) return grid;
    const bool at_end = cycle.cells >= limit || Index(grid.history.size()) > cycles;
    const std::vector<Index> marked = at_end ? std::vector<Index>{}
                                      : goal.marking > 0
                                          ? marked_cells(grid.last.indicators, goal.marking, limit - cycle.cells)
                                          : economical_cells(grid.last.indicators, q, limit - cycle.cells);
    Vector finer = bisected(grid.t, marked);
    if (finer.size() == grid.t.size()) {  // the end, or nothing left to halve
      if (options.tolerance > 0) {
        grid.status = Status::tolerance_not_met;
        grid.reason = text("the error of the quantity is estimated at %.2g on %td cells, %.2g was asked for",
                           std::abs(cycle.estimate), cycle.cells, options.tolerance);
      }
      return grid;
    }
    if (options.interrupted && options.interrupted()) {
      grid.status = Status::interrupted;
      grid.reason = text("stopped at %td cells", cycle.cells);
      return grid;
    }
    grid.t = std::move(finer);
  }
}

}  // namespace bromwich
