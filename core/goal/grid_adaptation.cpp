#include "core/goal/grid_adaptation.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>

namespace bromwich {
namespace {

constexpr Index most_refinements = 1000;

Vector as_vector(const std::vector<double>& t) { return Eigen::Map<const Vector>(t.data(), Index(t.size())); }

GoalCycle record(const GoalEvaluation& e, std::optional<double> exact) {
  GoalCycle cycle;
  cycle.cells = e.indicators.size();
  cycle.sizes = e.sizes;
  cycle.quantity = std::isnan(e.quantity) ? std::numeric_limits<double>::quiet_NaN() : e.quantity;  // without a sign
  cycle.estimate = e.indicators.sum();
  cycle.absolute = e.indicators.cwiseAbs().sum();
  if (!exact || e.blind) return cycle;
  const double error = e.quantity - *exact, noise = std::max(e.rounding, epsilon * cycle.absolute);
  if (std::abs(error) > noise) cycle.effectivity = cycle.estimate / error;
  return cycle;
}

}  // namespace

Vector first_grid(double T, Index cells, const std::vector<double>& breaks) {
  std::vector<double> t;
  for (Index i = 0; i <= cells; ++i) t.push_back(i == cells ? T : T * double(i) / double(cells));
  for (const double s : breaks) {
    const auto nearest =
        std::min_element(t.begin(), t.end(), [s](double a, double b) { return std::abs(a - s) < std::abs(b - s); });
    // A point that differs from the break only by rounding is moved to it.
    if (std::abs(*nearest - s) > 16 * epsilon * T)
      t.push_back(s);
    else if (*nearest > 0 && *nearest < T)
      *nearest = s;
  }
  std::sort(t.begin(), t.end());
  return as_vector(t);
}

namespace {

struct SizedCell {
  double size;  ///< |indicator|
  Index cell;
};

/// Sorted by decreasing size; cells of equal size keep the order of the grid.
std::vector<SizedCell> by_size(const Vector& indicators) {
  std::vector<SizedCell> cells(std::size_t(indicators.size()));
  for (Index i = 0; i < indicators.size(); ++i) cells[std::size_t(i)] = {std::abs(indicators[i]), i};
  std::sort(cells.begin(), cells.end(), [](const SizedCell& a, const SizedCell& b) {
    return a.size > b.size || (a.size == b.size && a.cell < b.cell);
  });
  return cells;
}

/// The first `count` of them, sorted in the order of the grid.
std::vector<Index> first_cells(const std::vector<SizedCell>& cells, Index count) {
  std::vector<char> chosen(cells.size(), 0);
  for (Index k = 0; k < count; ++k) chosen[std::size_t(cells[std::size_t(k)].cell)] = 1;
  std::vector<Index> first;
  first.reserve(std::size_t(count));
  for (std::size_t i = 0; i < chosen.size(); ++i)
    if (chosen[i]) first.push_back(Index(i));
  return first;
}

double whole_power(double base, int exponent) {
  double power = 1;
  for (int k = 0; k < exponent; ++k) power *= base;
  return power;
}

}  // namespace

std::vector<Index> marked_cells(const Vector& indicators, double marking, Index most) {
  const std::vector<SizedCell> cells = by_size(indicators);
  const double wanted = marking * indicators.cwiseAbs().sum();
  double covered = 0;
  std::size_t count = 0;
  while (count < cells.size() && Index(count) < most && covered < wanted && cells[count].size > 0)
    covered += cells[count++].size;
  return first_cells(cells, Index(count));
}

std::vector<Index> economical_cells(const Vector& indicators, int q, Index most) {
  const std::vector<SizedCell> cells = by_size(indicators);
  const double gain = 1 - std::exp2(-q);
  double left = indicators.cwiseAbs().sum(), least = INFINITY;
  Index best = 0;
  for (Index count = 1; count <= Index(cells.size()) && cells[std::size_t(count - 1)].size > 0; ++count) {
    left -= gain * cells[std::size_t(count - 1)].size;
    const double cost = left * whole_power(1 + double(count) / double(cells.size()), q);
    if (cost >= least) continue;
    least = cost;
    best = count;
  }
  return first_cells(cells, std::min(best, most));
}

namespace {

/// The ends of `count` equal cells from `from` to `to`, but for `from` itself.
void cut(double from, double to, Index count, std::vector<double>& times) {
  for (Index k = 1; k <= count; ++k) times.push_back(k == count ? to : from + (to - from) * double(k) / double(count));
}

/// The ends of blocks of about `length`, equal between two breaks.
std::vector<double> block_ends(double T, double length, const std::vector<double>& breaks) {
  std::vector<double> at{0};
  const auto add_until = [&](double end) {
    const double from = at.back();
    cut(from, end, std::max<Index>(1, Index(std::lround((end - from) / length))), at);
  };
  for (const double end : breaks) add_until(end);
  add_until(T);
  return at;
}

/// The contribution of each block if it were one cell, (Σ c_i^{1/(q+1)})^{q+1} over its cells, relative to the largest.
/// `wanted`: c_i^{1/(q+1)} of the cells of t; a cell in two blocks counts by its parts.
Vector block_costs(const Vector& t, const Vector& wanted, int q, const std::vector<double>& at) {
  const Index blocks = Index(at.size()) - 1;
  Vector cost = Vector::Zero(blocks);
  for (Index i = 0, b = 0; i < wanted.size();) {
    const double right = std::min(t[i + 1], at[std::size_t(b) + 1]), left = std::max(t[i], at[std::size_t(b)]);
    cost[b] += wanted[i] * std::max(right - left, 0.) / (t[i + 1] - t[i]);
    if (t[i + 1] <= at[std::size_t(b) + 1] || b + 1 == blocks)
      ++i;
    else
      ++b;
  }
  return (cost / cost.maxCoeff()).unaryExpr([q](double c) { return std::pow(c, q + 1); });
}

/// Numbers n of cells with Σ cost n^-q least: one cell more where that gains most, which is optimal because n^-q is
/// convex.
std::vector<Index> cells_of_blocks(const Vector& cost, int q, Index cells) {
  const Index blocks = cost.size();
  std::vector<Index> parts(std::size_t(blocks), 1);
  using Gain = std::pair<double, Index>;
  std::priority_queue<Gain> next;
  const auto gain = [&](Index b) {
    const double n = double(parts[std::size_t(b)]);
    return cost[b] * (std::pow(n, -q) - std::pow(n + 1, -q));
  };
  for (Index b = 0; b < blocks; ++b) next.push({gain(b), b});
  for (Index spare = cells - blocks; spare > 0; --spare) {
    const Index b = next.top().second;
    next.pop();
    ++parts[std::size_t(b)];
    next.push({gain(b), b});
  }
  return parts;
}

}  // namespace

Vector divided(const Vector& t, const Vector& indicators, int q, Index cells, const std::vector<double>& breaks) {
  const Vector wanted = indicators.unaryExpr([q](double eta) { return std::pow(std::abs(eta), 1. / (q + 1)); });
  if (!(wanted.sum() > 0)) return t;
  const double T = t[t.size() - 1];
  const std::vector<double> at = block_ends(T, T / double(std::max<Index>(1, cells / 4)), breaks);
  if (Index(at.size()) - 1 > cells) return t;
  const std::vector<Index> parts = cells_of_blocks(block_costs(t, wanted, q, at), q, cells);
  std::vector<double> finer{0};
  for (std::size_t b = 0; b < parts.size(); ++b) cut(at[b], at[b + 1], parts[b], finer);
  return as_vector(finer);
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
  return as_vector(points);
}

namespace {

/// All cells halved, the first ones if that is too many.
Vector halved(const Vector& t, Index limit) {
  const Index cells = t.size() - 1;
  std::vector<Index> all(std::size_t(std::min(cells, limit - cells)));
  std::iota(all.begin(), all.end(), Index(0));
  return bisected(t, all);
}

Vector refined_grid(const AdaptedGrid& grid, const GoalOptions& goal, int q, Index limit,
                    const std::vector<double>& breaks) {
  const Index cells = grid.t.size() - 1, most = limit - cells;
  const Vector& indicators = grid.last.indicators;
  if (grid.last.blind) return halved(grid.t, limit);
  if (goal.refinement == Refinement::division)
    return divided(grid.t, indicators, q, std::min(2 * cells, limit), breaks);
  return bisected(
      grid.t, goal.marking > 0 ? marked_cells(indicators, goal.marking, most) : economical_cells(indicators, q, most));
}

/// What the sum of the last indicators may miss. Large ones of both signs cancel by chance, also where each is off by a
/// large share. The quantities of two grids less their estimates are the same value but for that: their difference is a
/// share of the coarser grid's indicators. The largest share since the cells were an eighth is taken for the last grid.
double doubt(const std::vector<GoalCycle>& history) {
  constexpr Index fewer = 8;
  double share = history.size() > 1 ? 0 : 1;
  for (std::size_t k = history.size() - 1; k > 0 && fewer * history[k].cells > history.back().cells; --k) {
    const GoalCycle &coarse = history[k - 1], &fine = history[k];
    const double apart = std::abs((fine.quantity - fine.estimate) - (coarse.quantity - coarse.estimate));
    if (apart > 0) share = std::max(share, apart / coarse.absolute);
  }
  return share > 0 ? std::min(share, 1.) * history.back().absolute : 0;
}

/// Whether the last grid meets the tolerance: by its error where that is known, otherwise by its estimate and what that
/// may miss.
bool meets(double tolerance, const AdaptedGrid& grid, std::optional<double> exact) {
  const GoalCycle& last = grid.history.back();
  if (!(tolerance > 0) || grid.last.blind) return false;
  const double more = exact ? 0 : doubt(grid.history);
  return std::abs(last.estimate) + more <= tolerance && (!exact || std::abs(last.quantity - *exact) <= tolerance);
}

void miss(double tolerance, AdaptedGrid& grid, std::optional<double> exact) {
  const GoalCycle& last = grid.history.back();
  grid.status = Status::tolerance_not_met;
  grid.reason = text("the error of the quantity is estimated at %.2g on %td cells, above the tolerance %.2g",
                     std::abs(last.estimate) + (exact ? 0 : doubt(grid.history)), last.cells, tolerance);
}

}  // namespace

AdaptedGrid adapt_grid(Vector t, const Options& options, const GoalOptions& goal, const QuantityOfInterest& quantity,
                       const GridBounds& bounds, const std::function<GoalEvaluation(const Vector& t)>& evaluate) {
  const bool open_ended = goal.cycles > 0 || options.tolerance > 0;
  const Index limit = options.steps > 0 ? options.steps : open_ended ? bounds.most_cells : bounds.default_cells;
  const Index cycles = goal.cycles > 0 ? goal.cycles : most_refinements;
  const std::optional<double> exact = quantity.exact();
  const int q = quantity.order(order(goal.scheme));
  AdaptedGrid grid;
  Timer timer;
  bool all_halved = false;
  for (grid.t = std::move(t);;) {
    grid.last = evaluate(grid.t);
    GoalCycle cycle = record(grid.last, exact);
    cycle.seconds = timer.lap();
    grid.history.push_back(cycle);
    note(options.log, LogLevel::info, "grid of %td cells: quantity %.6g, error about %.2e", cycle.cells, cycle.quantity,
         cycle.estimate);
    if (options.progress) options.progress({Index(grid.history.size()), cycle.estimate, limit});
    if (!std::isfinite(cycle.quantity) || !std::isfinite(cycle.absolute)) {
      grid.status = Status::nonfinite;
      grid.reason = text("the quantity or its estimate is not finite on %td cells", cycle.cells);
      return grid;
    }
    if (meets(options.tolerance, grid, exact)) {
      // A cell whose error its indicator does not see is not marked on any grid: all cells halved show it.
      const bool confirmed = all_halved || exact || cycle.cells > limit / 2;
      if (confirmed) return grid;
      grid.t = halved(grid.t, limit);
      all_halved = true;
      continue;
    }
    all_halved = false;
    // At the requested number of cells the grid is divided once more: the previous one, with half as many cells, had
    // less accurate indicators.
    const bool full = cycle.cells >= limit, begun = grid.history.size() > 1;
    const bool once_more = full && begun && goal.refinement == Refinement::division && !grid.last.blind &&
                           grid.history[grid.history.size() - 2].cells < limit;
    const bool at_end = (full && !once_more) || Index(grid.history.size()) > cycles;
    Vector finer = at_end ? grid.t : refined_grid(grid, goal, q, limit, bounds.breaks);
    if (finer.size() == grid.t.size() && (!once_more || finer == grid.t)) {  // the end, or nothing left to refine
      if (options.tolerance > 0) miss(options.tolerance, grid, exact);
      if (options.tolerance > 0 && options.steps == 0 && full)
        grid.reason += bounds.memory_bound ? "; more do not fit the memory" : "; set steps to allow more";
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
