#pragma once
// The tables of small dense scenes that are stepped side by side (core/host/scene_steps.hpp), as one row of numbers for
// each plan of steps. Many scenes share a plan, or each has its own.

#include "../base/types.hpp"

namespace bromwich::scene_steps {

/// Tables of a plan, in the order of the row. For the letters see Steps. Matrices are stored row by row.
enum class PlanTable {
  E,               ///< m x m
  L,               ///< m x n, with stages 2n x m
  R,               ///< m x n, with stages m x 2n
  N,               ///< n x m
  M,               ///< n x n
  B,               ///< m x n
  growth_E,        ///< m x m, of the rule by which perturbations grow
  growth_G,        ///< m x n
  size_of_E,       ///< |growth_E|
  size_of_R,       ///< |R| of that rule
  y_unit,          ///< n, of y in the units of the scene
  w_unit,          ///< n
  x_up,            ///< m: rows in the units of the scene are x x_up / x_down
  x_down,          ///< m
  y_up,            ///< n
  y_down,          ///< n
  steps,           ///< u x u: the problem of a step, in scaled units
  step_rows,       ///< u, its scaling
  step_columns,    ///< u
  growth,          ///< n x n, with stages: the problem of that other rule; otherwise it is the one of a step
  growth_rows,     ///< n
  growth_columns,  ///< n
  drift_map,       ///< m x 2k: SourceMaps (batch/lane_plan.hpp)
  q_map,           ///< 2n x 2k, with stages
  growth_map,      ///< m x k
  g_scale,         ///< u
  count
};

/// Where they are. k: numbers by which f is stated, 0 where tables of f are shared.
struct PlanLayout {
  Index m = 0, n = 0, k = 0;
  bool stages = false;

  constexpr Index unknowns() const { return stages ? 2 * n : n; }
  constexpr Index sets() const { return Index(1) << unknowns(); }

  constexpr Index size_of(PlanTable table) const {
    const Index u = unknowns(), of_stages = stages ? 2 : 1;
    switch (table) {
      case PlanTable::E:
      case PlanTable::growth_E:
      case PlanTable::size_of_E:
        return m * m;
      case PlanTable::L:
      case PlanTable::R:
        return of_stages * m * n;
      case PlanTable::N:
      case PlanTable::B:
      case PlanTable::growth_G:
      case PlanTable::size_of_R:
        return m * n;
      case PlanTable::M:
        return n * n;
      case PlanTable::growth:
        return stages ? n * n : 0;
      case PlanTable::growth_rows:
      case PlanTable::growth_columns:
        return stages ? n : 0;
      case PlanTable::x_up:
      case PlanTable::x_down:
        return m;
      case PlanTable::steps:
        return u * u;
      case PlanTable::step_rows:
      case PlanTable::step_columns:
      case PlanTable::g_scale:
        return u;
      case PlanTable::drift_map:
        return 2 * m * k;
      case PlanTable::q_map:
        return stages ? 4 * n * k : 0;
      case PlanTable::growth_map:
        return m * k;
      case PlanTable::count:
        return 0;
      default:
        return n;
    }
  }
  /// Of the first number of a table; of `count`, the length of the row.
  constexpr Index at(PlanTable table) const {
    Index sum = 0;
    for (int i = 0; i < int(table); ++i) sum += size_of(PlanTable(i));
    return sum;
  }
};

}  // namespace bromwich::scene_steps
