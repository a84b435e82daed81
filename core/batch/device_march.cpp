#include "core/batch/device_march.hpp"

#include "core/lcp/active_set.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

StoredSets stored(const ActiveSetTable& table) {
  const Index u = table.size(), sets = Index(1) << u;
  StoredSets s{RowMatrix::Zero(sets * u, u), Vector(u), Vector(u), true};
  for (Index i = 0; i < u; ++i) s.rows[i] = table.row_scale(i), s.columns[i] = table.column_scale(i);
  for (Index set = 0; set < sets; ++set) {
    const ActiveSetTable::Entry& entry = table.at(unsigned(set));
    if (entry.usable)
      s.V.middleRows(set * u, u) = Eigen::Map<const RowMatrix>(entry.V.data(), u, u);
    else
      s.V(set * u, 0) = NAN;
  }
  return s;
}

}  // namespace

SceneMarchProblem scene_march_problem(const LanePlan& p) {
  SceneMarchProblem s;
  s.m = p.m, s.n = p.n, s.J = p.J, s.h = p.h, s.most_growth = p.most_growth;
  s.stages = p.stages, s.surely_P = p.surely_P, s.rigid = p.rigid;
  s.E = p.whole.E, s.L = p.whole.L, s.R = p.whole.R, s.N = p.N, s.M = p.M, s.B = p.B;
  const GrowthMaps growth = p.growth();
  s.growth_E = growth.E, s.growth_G = growth.G;
  s.size_of_E = growth.E.cwiseAbs(), s.size_of_R = growth.R.cwiseAbs();
  s.steps = stored(*p.whole.problem);
  s.steps.all_solutions = p.certain;
  s.growth = stored(*growth.problem);
  s.longest.resize(Index(1) << p.n);
  for (Index set = 0; set < s.longest.size(); ++set) s.longest[set] = p.longest(unsigned(set));
  s.drift = p.sources.drift, s.g = p.sources.g, s.f = p.sources.f;
  s.at_points = p.stages ? p.sources.at_points : p.sources.g;
  s.growth_drift = p.stages ? p.sources.growth_drift : p.sources.drift;
  if (p.euler) {
    s.seen = p.euler->seen;
    s.euler.resize(s.longest.size() * p.n, p.n);
    for (Index set = 0; set < s.longest.size(); ++set)
      s.euler.middleRows(set * p.n, p.n) = p.euler->V[std::size_t(set)];
  }
  s.part.resize(p.m);
  for (Index i = 0; i < p.m; ++i) s.part[i] = std::cos(1.0 + 2.399963 * double(i));
  s.x_unit = p.units.x, s.y_unit = p.units.y, s.w_unit = p.units.w;
  return s;
}

LaneStart start_of_lane(const LanePlan& p, const Vector& x0, const Vector& g) {
  LaneStart start;
  const Vector begin = p.N * x0 + g, terms = p.N.cwiseAbs() * x0.cwiseAbs() + g.cwiseAbs();
  Vector q = begin;
  const double share = 4 * double(p.m + 1) * epsilon;  // as core/march/outcome.cpp
  for (Index i = 0; i < p.n; ++i)
    if (begin[i] < 0 && begin[i] >= -share * terms[i]) q[i] = 0;
  start.y = Vector::Zero(p.n);
  if (p.at_zero) {
    double value[largest_tabulated] = {};
    unsigned set = 0;
    start.found = p.at_zero->solve(q.data(), set, value);
    for (Index i = 0; i < p.n && start.found; ++i)
      if (set >> i & 1u) start.y[i] = std::max(p.at_zero->column_scale(i) * value[i], 0.0);
  } else {
    start.found = ActiveSetLcp(p.M, p.lcp_class).solve(q, start.y).solved;
    if (!start.found) start.y.setZero();
  }
  start.other = start.found && p.others && p.others->any(begin, start.y);
  return start;
}

}  // namespace bromwich
