#include "core/galerkin/location.hpp"

#include "core/kernel/step_defects.hpp"
#include "core/result/switching.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

BrokenGrid divide_at_breakpoints(const Scene& scene, Index N) {
  constexpr double same_time = 1e-6;  // of an interval: breakpoints closer than that to a node are left to moments
  const double h = scene.T / double(N);
  BrokenGrid grid;
  grid.kept.push_back(0);
  Index whole = 0;  // intervals since the last part
  auto next = scene.breakpoints.begin();
  for (Index k = 0; k < N; ++k) {
    const double begin = scene.T * (double(k) / double(N)),
                 end = k + 1 == N ? scene.T : scene.T * (double(k + 1) / double(N));
    double last = begin;
    for (; next != scene.breakpoints.end() && *next < end; ++next) {
      if (*next - last <= same_time * h || end - *next <= same_time * h) continue;
      if (whole > 0) grid.parts.push_back({begin, whole});
      whole = 0;
      grid.parts.push_back({*next, 1});
      grid.of.push_back(k);
      last = *next;
    }
    if (last > begin)
      grid.parts.push_back({end, 1});
    else
      ++whole;
    grid.of.push_back(k);
    grid.kept.push_back(Index(grid.of.size()));
  }
  if (whole > 0) grid.parts.push_back({scene.T, whole});
  return grid;
}

void keep_nodes(const BrokenGrid& grid, Result& result) {
  if (result.y.rows() != Index(grid.of.size()) + 1) return;
  const Index N = Index(grid.kept.size()) - 1;
  const RowMatrix integral = integral_of_y(result);
  std::vector<Index> first(grid.kept.begin(), grid.kept.end() - 1);
  result.t = result.t(grid.kept).eval();
  for (RowMatrix* rows : {&result.y, &result.x, &result.trace})
    if (rows->rows() > 0) *rows = (*rows)(grid.kept, Eigen::all).eval();
  result.y_left = result.y_left(first, Eigen::all).eval();
  result.y_integral = integral(grid.kept, Eigen::all);
  result.steps = N;
  result.defects = std::make_shared<StepDefects>();
  if (result.interval_rules.empty()) return;
  std::vector<IntervalRule> rules(std::size_t(N), IntervalRule::galerkin);
  for (std::size_t i = 0; i < grid.of.size(); ++i)
    if (result.interval_rules[i] != IntervalRule::galerkin) rules[std::size_t(grid.of[i])] = result.interval_rules[i];
  result.interval_rules = std::move(rules);
}

LocatedGrid locate_switches(const Scene& scene, const Result& result, const std::vector<double>& breakpoints, Index N) {
  constexpr double same_time = 1e-2;   // of an interval: switches closer than that share a node
  constexpr double same_break = 1e-6;  // likewise breakpoints
  constexpr double located = 0.49;     // of a step: the error of what is known no better is 1/2
  const double h = scene.T / double(N);
  LocatedGrid grid;
  const auto beside_breakpoint = [&](double t, double apart) {
    const auto next = std::lower_bound(breakpoints.begin(), breakpoints.end(), t - apart);
    return next != breakpoints.end() && *next <= t + apart;
  };
  std::vector<double> nodes;
  for (const Switch& s : switches(result)) {
    if (std::binary_search(scene.free_rows.begin(), scene.free_rows.end(), s.component)) continue;
    const bool known = s.error < located * h;
    if (!known && !beside_breakpoint(s.t, h)) {
      ++grid.missed;
      continue;
    }
    ++grid.located;
    const bool has_node = s.t <= same_time * h || scene.T - s.t <= same_time * h ||
                          beside_breakpoint(s.t, same_time * h) ||
                          (!nodes.empty() && s.t - nodes.back() <= same_time * h);
    if (known && !has_node) nodes.push_back(s.t);
  }
  nodes.insert(nodes.end(), breakpoints.begin(), breakpoints.end());
  std::sort(nodes.begin(), nodes.end());
  double begin = 0;
  const auto add_part = [&](double end) {
    grid.parts.push_back({end, std::max<Index>(1, Index(std::lround((end - begin) / h)))});
    begin = end;
  };
  for (const double t : nodes)
    if (t - begin > same_break * h && scene.T - t > same_break * h) add_part(t);
  add_part(scene.T);
  return grid;
}

bool same_grid(const std::vector<GridPart>& a, const std::vector<GridPart>& b, double apart) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [apart](const GridPart& i, const GridPart& j) {
    return i.intervals == j.intervals && std::abs(i.end - j.end) <= apart;
  });
}

RowMatrix coefficients_on(const Result& r, const GalerkinProblem& p) {
  const Index n = r.y_left.cols(), N = r.y_left.rows();
  RowMatrix z(p.N, 2 * n);
  Index k = 0;
  for (Index j = 0; j < p.N; ++j) {
    const double t = (p.t[j] + p.t[j + 1]) / 2;
    while (k + 1 < N && r.t[k + 1] < t) ++k;
    const double s = (t - r.t[k]) / (r.t[k + 1] - r.t[k]);
    z.row(j).head(n) = (1 - s) * r.y_left.row(k) + s * r.y.row(k + 1);
    z.row(j).tail(n) = z.row(j).head(n);
  }
  return z;
}

}  // namespace bromwich
