#include "batch/device_march.hpp"

#include <cmath>

namespace bromwich {

StoredSets stored_sets(const ActiveSetTable& table) {
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

SceneMarchProblem scene_march_problem(const LanePlan& p) {
  SceneMarchProblem s;
  s.m = p.m, s.n = p.n, s.J = p.J, s.h = p.h, s.most_growth = p.most_growth;
  s.stages = p.stages, s.surely_P = p.surely_P, s.rigid = p.rigid;
  s.E = p.whole.E, s.L = p.whole.L, s.R = p.whole.R, s.N = p.N, s.M = p.M, s.B = p.B;
  const GrowthMaps growth = p.growth();
  s.growth_E = growth.E, s.growth_G = growth.G;
  s.size_of_E = growth.E.cwiseAbs(), s.size_of_R = growth.R.cwiseAbs();
  s.steps = stored_sets(*p.whole.problem);
  s.steps.all_solutions = p.certain;
  s.growth = stored_sets(*growth.problem);
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

}  // namespace bromwich
