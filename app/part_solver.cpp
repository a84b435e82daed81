#include "app/part_solver.hpp"

#include <algorithm>

namespace bromwich::app {

namespace {

constexpr double same_point = 1e-6;  ///< of a step: as close to a jump as the end of a part must not be

}  // namespace

Index Boundaries::from(Index wanted) const {
  Index j = std::min(wanted, steps_);
  while (j < steps_ && jumps(j)) ++j;
  return j;
}

bool Boundaries::jumps(Index j) const {
  const std::vector<double>& times = scene_.breakpoints;
  const auto next = std::lower_bound(times.begin(), times.end(), time(j) - same_point * h_);
  return next != times.end() && *next <= time(j) + same_point * h_;
}

Result PartSolver::solve(const TimesOfRun& times, const Vector& x) {
  const double t = times.of(0), length = times.length;
  const Index steps = times.steps;
  part_ = part_of(scene_, t, length, x);
  for (const auto source : {&Scene::f, &Scene::g})
    if (scene_.*source)
      part_.*source = [given = scene_.*source, times](double s, Eigen::Ref<Vector> v) { given(times.of(s), v); };
  part_.breakpoints = times.in_part(scene_.breakpoints);
  part_.exact = {};
  part_.default_steps = steps;
  if (!solver_ || steps != steps_) {
    options_.steps = steps_ = steps;
    length_ = length;
    solver_ = std::make_unique<Solver>(part_, backend_, options_);
  } else {
    solver_->set_x0(x);
    if (part_.f || part_.g)
      solver_->set_sources(part_.f, part_.g, within(part_.breakpoints), part_.breakpoints_are_all);
  }
  return solver_->solve();
}

void PartSolver::record_all() {
  options_.states = StateSelection::all;
  options_.components.clear();
  solver_.reset();
}

Result PartSolver::solve_again() {
  options_.steps = steps_;
  solver_ = std::make_unique<Solver>(part_, backend_, options_);
  return solver_->solve();
}

// Parts of equally many steps differ in length by rounding.
std::vector<double> PartSolver::within(std::vector<double> times) const {
  for (double& t : times) t = std::min(t, length_);
  return times;
}

}  // namespace bromwich::app
