#include "batch/array_scenes.hpp"

#include "batch/device_march.hpp"
#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/has_impacts.hpp"

#include <cmath>
#include <utility>

namespace bromwich {

namespace {

using scene_steps::HeldPacked;
using scene_steps::HeldState;

constexpr double solved_residual = 1e-9;  ///< as core/solve/certification.cpp
constexpr const char* doubts =
    "the steps may be too coarse: y alternates, or perturbations or rounding grow along the solution; use more steps, "
    "or "
    "solve, which looks again with half the step";
constexpr const char* one_sided_at_start =
    "not differentiable here: y = w = 0 at t = 0 for a constraint, where derivatives are one-sided; change x0 or g(0) "
    "slightly";

const DenseDynamics& dense_of(const Scene& scene) {
  const auto refuse = [](const std::string& found, const std::string& remedy) { throw Error("scene", found, remedy); };
  scene.validate();
  if (scene.boundary) refuse("has boundary values", "use solve, which takes them");
  if (has_impacts(scene)) refuse("has restitution", "use solve_batch");
  if (!scene.cones.empty()) refuse("has friction on circles", "use solve_batch");
  if (!scene.memories.empty()) refuse("has modes with memory", "use solve_batch");
  if (!scene.free_rows.empty()) refuse("has free rows", "use solve, which eliminates them");
  const DenseDynamics* dense = scene.dynamics->small_state();
  if (!dense || scene.dynamics->has_mass())
    refuse("has dynamics that are not dense, or have E", "give A, B and N as dense matrices, and E^{-1} A, E^{-1} B");
  const Index most = scene_steps::most_held;
  if (scene.states() < 1 || scene.constraints() < 1 || scene.states() > most || scene.constraints() > most)
    refuse(text("has %ld states and %ld constraints", long(scene.states()), long(scene.constraints())),
           text("use solve, or scenes with 1 to %ld of each", long(most)));
  return *dense;
}

// The steps and what they are checked by. Throws Error unless they are those of a continuous y that lanes take.
SceneArraysProblem checked_problem(const Scene& scene, Backend& backend, Index J) {
  const DenseDynamics& dense = dense_of(scene);
  if (J < 1) throw Error("steps", text("found %ld", long(J)), "give a whole number from 1 on");
  if (!has_one_solution(known_class(scene.M, scene.lcp_class)))
    throw Error("M", "is not of class P, and y may jump", "use solve, or backend='cpu'");
  std::string why;
  Scene at_rest = scene;
  at_rest.x0 = Vector::Zero(scene.states());
  const std::unique_ptr<LanePlan> plan = LanePlan::make(at_rest, backend, J, true, nullptr, why);
  if (!plan) throw Error("scene", "cannot be stepped on arrays: " + why, "use solve");
  if (plan->stages) throw Error("scene", "has a kernel that rings in time", "use solve");
  SceneArraysProblem problem = scene_arrays_problem(dense, to_dense(scene.M), scene.T, J);
  problem.most_growth = 2 * plan->most_growth;  // as a single solve
  problem.longest.resize(Index(1) << problem.n);
  for (Index set = 0; set < problem.longest.size(); ++set) problem.longest[set] = plan->longest(unsigned(set));
  return problem;
}

}  // namespace

SceneArraysProblem scene_arrays_problem(const DenseDynamics& d, const Matrix& M, double T, Index J) {
  SceneArraysProblem p;
  p.m = d.A.rows(), p.n = M.rows(), p.J = J, p.h = T / double(J);
  const StepOperators step = step_operators(d.A, Rule::exponential, p.h, J);
  p.E = step.decay, p.L = step.left, p.R = step.right;
  p.B = d.B, p.N = d.N, p.M = M;
  const Matrix of_step = M + d.N * (step.right * d.B);
  p.steps = stored_sets(ActiveSetTable(of_step, nullptr));
  p.start = stored_sets(ActiveSetTable(M, nullptr));
  return p;
}

std::string in_words(const HeldState& state, double h) {
  const double t = h * double(state.step);
  switch (state.verdict) {
    case HeldState::unsolved:
      return text("the problem at t = %.6g is not solved on arrays; use solve for this scene", t);
    case HeldState::undetermined:
      return text(
          "not differentiable here: the active constraints at t = %.6g do not determine y; remove constraints "
          "that repeat each other",
          t);
    case HeldState::other_steps:
      return text(
          "not differentiable here: the steps of the grid do not give y of the result at t = %.6g; solve on "
          "more steps",
          t);
    case HeldState::degenerate:
      return text(
          "not differentiable here: y_%ld = w_%ld = 0 at t = %.6g, where derivatives are one-sided; change the "
          "data or the number of steps slightly",
          long(state.constraint), long(state.constraint), t);
    default:
      return "";
  }
}

ArrayScenes::ArrayScenes(const Scene& scene, Backend& backend, Index steps, Index scenes)
    : backend_(backend),
      problem_(checked_problem(scene, backend, steps)),
      directions_(scene.dynamics->small_state()->A, problem_.h),
      plan_(make_scene_arrays(backend, problem_, scenes)) {
  const Index rows = scenes * (steps + 1);
  y_ = backend.array(rows, problem_.n);
  x_ = backend.array(rows, problem_.m);
  w_ = backend.array(rows, problem_.n);
}

std::vector<std::string> ArrayScenes::solve(const SceneSources& sources) {
  const SceneArrays::States solved = plan_->solve(sources, *y_);
  states_ = plan_->follow(sources, *y_, *x_, *w_);
  std::vector<std::string> failures;
  reasons_.clear();
  for (std::size_t k = 0; k < states_.size(); ++k) {
    const HeldState& state = states_[k];
    std::string failure = in_words(solved[k], problem_.h);
    if (failure.empty() && !(state.residual <= solved_residual))
      failure = text("the residual of the natural map is %.3g, above %.3g", state.residual, solved_residual);
    if (failure.empty() && state.doubtful) failure = doubts;
    reasons_.push_back(failure.empty() ? in_words(state, problem_.h) : "the scene is not solved: " + failure);
    failures.push_back(std::move(failure));
  }
  return failures;
}

std::vector<DerivativeMargin> ArrayScenes::margins() const {
  std::vector<DerivativeMargin> found;
  for (const HeldState& state : states_)
    found.push_back(
        {state.verdict == HeldState::fine ? state.margin : 0, problem_.h * double(state.step), state.constraint});
  return found;
}

std::vector<std::string> ArrayScenes::vjp(const SceneRows<const Array>& of, const SceneGradient& given,
                                          ByMatrices* by) {
  if (states_.empty()) throw Error("derivative", "has no solution yet", "solve first");
  SceneGradient bar = given;
  const HeldPacked packed{problem_.m, problem_.n};
  if (by && !sums_) sums_ = backend_.array(scenes(), packed.size());
  bar.matrices = by ? sums_.get() : nullptr;
  const std::vector<char> decided = plan_->backward(of, bar);
  std::vector<std::string> reasons = reasons_;
  for (std::size_t k = 0; k < reasons.size(); ++k)
    if (reasons[k].empty() && !decided[k]) reasons[k] = one_sided_at_start;
  if (by) {
    RowMatrix sums;
    backend_.download(*sums_, sums);
    *by = taken_apart(sums);
  }
  return reasons;
}

ArrayScenes::ByMatrices ArrayScenes::taken_apart(const RowMatrix& sums) const {
  const Index m = problem_.m, n = problem_.n;
  const HeldPacked at{m, n};
  ByMatrices by;
  for (Index k = 0; k < sums.rows(); ++k) {
    const double* of = sums.row(k).data();
    by.A.push_back(directions_.backward(of));
    by.B.push_back(Eigen::Map<const RowMatrix>(of + at.B(), m, n));
    by.N.push_back(Eigen::Map<const RowMatrix>(of + at.N(), n, m));
    by.M.push_back(Eigen::Map<const RowMatrix>(of + at.M(), n, n));
  }
  return by;
}

}  // namespace bromwich
