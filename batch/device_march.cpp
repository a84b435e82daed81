#include "batch/device_march.hpp"

#include <algorithm>
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

namespace {

using scene_steps::PlanLayout;
using scene_steps::PlanTable;

// 10^k, and 1 for the other sign: a number times 10^k is rounded once.
Vector factors(const std::vector<int>& k, int sign, Index n) {
  Vector all = Vector::Ones(n);
  for (Index i = 0; i < n && !k.empty(); ++i)
    if (sign * k[std::size_t(i)] > 0) all[i] = times_ten_to(sign * k[std::size_t(i)], 1);
  return all;
}

Vector powers(const std::vector<int>& k, Index n) {
  Vector all = Vector::Ones(n);
  for (Index i = 0; i < n && !k.empty(); ++i) all[i] = times_ten_to(k[std::size_t(i)], 1);
  return all;
}

SceneMarchProblem scene_march_problem(const LanePlan& p) {
  SceneMarchProblem s;
  s.layout = {p.m, p.n, 0, p.stages};
  s.J = p.J, s.h = p.h, s.most_growth = p.most_growth;
  s.surely_P = p.surely_P, s.certain = p.certain, s.rigid = p.rigid;
  s.judged = p.least_elements && !p.stages;
  s.part.resize(p.m);
  for (Index i = 0; i < p.m; ++i) s.part[i] = std::cos(1.0 + 2.399963 * double(i));
  return s;
}

}  // namespace

void write_plan(const LanePlan& p, const PlanLayout& layout, double* to) {
  const auto put = [&](PlanTable table, const auto& values) {
    if (layout.size_of(table) > 0) Eigen::Map<RowMatrix>(to + layout.at(table), values.rows(), values.cols()) = values;
  };
  const GrowthMaps growth = p.growth();
  put(PlanTable::E, p.whole.E), put(PlanTable::L, p.whole.L), put(PlanTable::R, p.whole.R);
  put(PlanTable::N, p.N), put(PlanTable::M, p.M), put(PlanTable::B, p.B);
  put(PlanTable::growth_E, growth.E), put(PlanTable::growth_G, growth.G);
  put(PlanTable::size_of_E, growth.E.cwiseAbs()), put(PlanTable::size_of_R, growth.R.cwiseAbs());
  put(PlanTable::y_unit, powers(p.units.y, p.n)), put(PlanTable::w_unit, powers(p.units.w, p.n));
  put(PlanTable::x_up, factors(p.units.x, 1, p.m)), put(PlanTable::x_down, factors(p.units.x, -1, p.m));
  put(PlanTable::y_up, factors(p.units.y, 1, p.n)), put(PlanTable::y_down, factors(p.units.y, -1, p.n));
  const auto put_problem = [&](PlanTable matrix, PlanTable rows, PlanTable columns, const ActiveSetTable& of) {
    put(matrix, of.scaled_matrix()), put(rows, of.row_scales()), put(columns, of.column_scales());
  };
  put_problem(PlanTable::steps, PlanTable::step_rows, PlanTable::step_columns, *p.whole.problem);
  put_problem(PlanTable::growth, PlanTable::growth_rows, PlanTable::growth_columns, *growth.problem);
  for (Index i = 0; i < layout.size_of(PlanTable::g_scale); ++i)
    to[layout.at(PlanTable::g_scale) + i] = p.maps.g.size() > 0 ? p.maps.g[i % p.n] : 1;
  if (layout.k == 0) return;
  put(PlanTable::drift_map, p.maps.drift), put(PlanTable::q_map, p.maps.q);
  put(PlanTable::growth_map, p.stages ? p.maps.growth : RowMatrix(RowMatrix::Zero(p.m, layout.k)));
}

SceneMarchProblem shared_march_problem(const LanePlan& p) {
  SceneMarchProblem s = scene_march_problem(p);
  s.plan.resize(s.layout.at(PlanTable::count));
  write_plan(p, s.layout, s.plan.data());
  s.drift = p.sources.drift, s.g = p.sources.g, s.f = p.sources.f;
  s.at_points = p.stages ? p.sources.at_points : p.sources.g;
  s.growth_drift = p.stages ? p.sources.growth_drift : p.sources.drift;
  if (!p.euler) return s;
  const Index sets = Index(1) << p.n;
  s.seen = p.euler->seen;
  s.euler.resize(sets * p.n, p.n);
  for (Index set = 0; set < sets; ++set) s.euler.middleRows(set * p.n, p.n) = p.euler->V[std::size_t(set)];
  return s;
}

SceneMarchProblem own_march_problem(const LanePlan& p, const SourceSamples& samples) {
  SceneMarchProblem s = scene_march_problem(p);
  s.layout.k = samples.f.cols();
  s.g = p.stages ? samples.g_stages : samples.g, s.at_points = samples.g;
  s.f = samples.f, s.driven = p.stages ? samples.f_stages : samples.f_ends;
  return s;
}

}  // namespace bromwich
