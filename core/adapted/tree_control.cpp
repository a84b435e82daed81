#include "core/adapted/tree_control.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

constexpr double accepted = 0.8;     ///< of a tolerance
constexpr double first_local = 0.2;  ///< of the tolerance: that of one step
constexpr int most_rounds = 12;

TreeMarch::Measure measure(const TreeGoal& goal, double local, const Result& seen) {
  const double of_x = local * (goal.x > 0 ? goal.x : goal.y), of_y = local * (goal.y > 0 ? goal.y : goal.x);
  const Vector x = of_x * goal.sizes.of_x(seen), y = of_y * goal.sizes.of_y(seen),
               mean = of_y * seen.t[seen.t.size() - 1] * goal.sizes.of_mean(seen);
  return [x, y, mean, of_y, jumps = goal.y_may_jump](const TreeRow& one, const TreeRow& two) {
    Vector apart = (one.y - two.y).cwiseAbs();
    if (jumps) apart = ((one.y.array() > 0) == (two.y.array() > 0)).select(apart, 0);
    const Vector size_of_y = y.cwiseMax(of_y * two.y.cwiseAbs());  // behind a jump y may be far above its rows
    const double e = std::max({largest_share((one.x - two.x).cwiseAbs(), x), largest_share(apart, size_of_y),
                               largest_share((one.integral - two.integral).cwiseAbs(), mean)});
    return one.apart.size() > 0 ? std::max({e, largest_share(one.apart, x), largest_share(one.missed, mean)}) : e;
  };
}

}  // namespace

Result as_result(const Vector& times, TreeRows rows) {
  Result r;
  r.t = times;
  r.steps = times.size() - 1;
  r.continuous = false;
  r.x = std::move(rows.x);
  r.y = std::move(rows.y);
  r.y_integral = std::move(rows.integral);
  return r;
}

std::optional<TreeSolution> march_to_goal(TreeMarch& tree, const TreeGoal& goal) {
  std::optional<TreeRows> rows = tree.coarse();
  double local = first_local;
  for (int round = 0; rows && round < most_rounds; ++round) {
    rows = tree.refine(measure(goal, local, as_result(tree.times(), *rows)));
    const std::optional<TreeRows> coarse = rows ? tree.coarse() : std::nullopt;
    if (!coarse) return std::nullopt;
    TreeSolution s;
    s.error = distance(as_result(tree.times(), *coarse), 1, as_result(tree.times(), *rows), 1, goal.sizes);
    s.steps = 2 * Index(tree.leaves().size());
    const double steps = double(s.steps);
    s.of_integral = goal.impulse || (goal.y_may_jump && s.error.y + steps * goal.rounding_of_y > accepted * goal.y);
    const double rounding = steps * (s.of_integral ? goal.rounding_of_mean : goal.rounding_of_y);
    const double share = std::max(goal.y > 0 ? (s.error_of_y() + rounding) / goal.y : 0,
                                  goal.x > 0 ? (s.error.of_x() + steps * goal.rounding_of_x) / goal.x : 0);
    if (share <= accepted) {
      s.rows = std::move(*rows);
      return s;
    }
    local *= std::clamp(0.5 * accepted / share, 1.0 / 32, 0.5);
  }
  return std::nullopt;
}

}  // namespace bromwich
