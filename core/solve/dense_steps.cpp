#include "core/solve/dense_steps.hpp"

#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/shooting/divided_shooting.hpp"
#include "core/solve/given_steps.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// The scene from the state at t on. Behind t = 0 what that has below a constraint is rounding.
Scene from_solution(const Scene& scene, double t, double length, const Vector& x) {
  constexpr double least_size = 1e-3;  // of the largest component
  Scene part = part_of(scene, t, length, x);
  if (t > 0 && part.dynamics->small_state() && x.size() > 0)
    part.x0 = nearest_feasible(part, x, x.cwiseAbs().cwiseMax(least_size * x.cwiseAbs().maxCoeff()));
  return part;
}

// The steps from a time point to a place behind it. A step that its march has divided, where transients are faster than
// a step, is divided here too: with small states that costs little, and others have transients behind breakpoints.
Index steps_between(const Scene& scene, Method method) {
  constexpr Index parts = 16;
  const bool divides = scene.dynamics->small_state() || !scene.breakpoints.empty();
  return divides && method != Method::euler ? parts : 1;
}

// The method that takes a step alone as `result` has taken it with all others.
Method stepping(const Result& result) {
  if (result.method == Method::shooting) return Method::march;
  if (result.form != "dual") return result.method;
  return by_euler(result) ? Method::euler : Method::march;
}

// The whole states at the time points before the places between them, one column for each place; NaN where they are not
// known. They are taken from marches over few steps at a time, so that no others are kept.
Matrix states_by_steps(const Scene& scene, Backend& backend, const Result& result, const std::vector<Place>& places) {
  constexpr Index most_numbers = 4000000;
  const Index m = scene.states();
  Matrix states = Matrix::Constant(m, Index(places.size()), NAN);
  Index last = 0;
  for (const Place& at : places) last = std::max(last, at.row);
  const double h = scene.T / double(result.steps);
  InnerOptions options;
  options.method = stepping(result);
  options.states = StateSelection::all;
  options.confirm = false;
  RowMatrix x = scene.x0.transpose();
  for (Index begin = 0;;) {
    for (Index k = 0; k < states.cols(); ++k)
      if (const Index row = places[std::size_t(k)].row - begin; row >= 0 && row < x.rows()) states.col(k) = x.row(row);
    begin += x.rows() - 1;
    if (begin >= last || x.rows() == 0 || !x.bottomRows(1).allFinite()) return states;
    options.steps = std::min(std::max<Index>(1, most_numbers / m), last - begin);
    const Vector from = x.bottomRows(1).transpose();
    x = solve_on_steps(from_solution(scene, double(begin) * h, double(options.steps) * h, from), backend, options).x;
  }
}

// Row k is the end of a march from the time point before.
void take_end(const Result& one, Index k, Result& sampled) {
  sampled.y.row(k) = one.y.bottomRows(1);
  sampled.y_integral.row(k) = integral_of_y(one).bottomRows(1);
  sampled.x.row(k) = one.x.row(one.steps)(sampled.x_components);
  if (sampled.trace.cols() > 0) sampled.trace.row(k) = one.trace.row(one.steps);
}

}  // namespace

Place place(const Result& result, double T, double t) {
  if (!(t >= 0) || !(t <= T * (1 + epsilon)))
    throw Error("times", text("found %.17g", t), text("give times from 0 to T = %.17g", T));
  const double steps = t / T * double(result.steps), nearest = std::round(steps);
  if (std::abs(steps - nearest) <= same_point) return {Index(nearest), 0};
  return {Index(steps), steps - std::floor(steps)};
}

bool on_grid(const std::vector<Place>& places) {
  return std::all_of(places.begin(), places.end(), [](const Place& at) { return at.part == 0; });
}

bool by_steps(const Scene& scene, const Result& result) {
  if (result.y_left.size() > 0) return false;
  const bool stepped = !scene.dynamics->small_state() && !scene.dynamics->modes();
  return !result.continuous || result.method == Method::euler || (stepped && !result.x_components.empty());
}

RowsBetween::RowsBetween(const Scene& scene, Backend& backend, double h) : scene_(scene), backend_(backend) {
  if (StepsBetween::suit(scene)) steps_.emplace(scene, h);
}

bool RowsBetween::take(double t, const Vector& x, const Vector& y, double s, Index k, Result& sampled) {
  return by_steps(t, x, y, s, k, sampled) || march(t, x, s, k, sampled);
}

bool RowsBetween::by_steps(double t, const Vector& x, const Vector& y, double s, Index k, Result& sampled) {
  const TreeRow* row = steps_ ? steps_->at(t, x, y, s) : nullptr;
  if (!row) return false;
  sampled.y.row(k) = row->y.transpose();
  sampled.y_integral.row(k) = row->integral.transpose();
  sampled.x.row(k) = row->x(sampled.x_components);
  if (sampled.trace.cols() > 0) sampled.trace.row(k) = observe(scene_.dynamics, row->x).transpose();
  return true;
}

bool RowsBetween::march(double t, const Vector& x, double s, Index k, Result& sampled) {
  InnerOptions options;
  options.method = Method::march;
  options.steps = steps_between(scene_, options.method);
  options.states = StateSelection::all;
  options.trace = sampled.trace.cols() > 0;
  options.confirm = false;
  const Result one = solve_on_steps(from_solution(scene_, t, s, x), backend_, options);
  if (one.status != Status::solved || !one.continuous) return false;
  take_end(one, k, sampled);
  return true;
}

void sample_by_steps(const Scene& given, Backend& backend, const Result& result, const std::vector<Place>& places,
                     Result& sampled) {
  const Scene scene = on_grid(places) ? given : with_all_breakpoints(given);
  std::vector<Place> between;
  for (const Place& at : places)
    if (at.part > 0) between.push_back(at);
  const bool recorded = Index(result.x_components.size()) == scene.states();
  const Matrix before = recorded || between.empty() ? Matrix() : states_by_steps(scene, backend, result, between);
  const double h = scene.T / double(result.steps);
  InnerOptions options;
  options.method = stepping(result);
  options.steps = steps_between(scene, options.method);
  options.states = StateSelection::all;
  options.trace = sampled.trace.cols() > 0;
  options.confirm = false;
  std::optional<RowsBetween> rows;
  if (options.method == Method::march) rows.emplace(scene, backend, h);
  Index next = 0;
  for (Index k = 0; k < Index(places.size()); ++k) {
    check_interruption();
    const Place& at = places[std::size_t(k)];
    sampled.y.row(k).setConstant(NAN);
    if (at.part == 0) {
      sampled.y.row(k) = result.y.row(at.row);
      sampled.x.row(k) = result.x.row(at.row);
      sampled.y_integral.row(k).setZero();
      continue;
    }
    const Vector x = recorded ? Vector(result.x.row(at.row)) : Vector(before.col(next++));
    if (!x.allFinite() || !result.y.row(at.row + 1).allFinite()) continue;
    if (rows && rows->by_steps(double(at.row) * h, x, result.y.row(at.row).transpose(), at.part * h, k, sampled))
      continue;
    // The layer behind a breakpoint may have begun in the step before, and has parts here as it has there.
    const double begin = double(at.row) * h, length = at.part * h;
    const auto edge = std::lower_bound(scene.breakpoints.begin(), scene.breakpoints.end(), begin - h);
    const bool in_layer = edge != scene.breakpoints.end() && *edge <= begin + length;
    options.compares_grids = options.look_inside_every_step = in_layer && !scene.dynamics->small_state();
    const Result one = solve_on_steps(from_solution(scene, begin, length, x), backend, options);
    if (one.status == Status::infeasible || one.x.rows() != options.steps + 1) continue;
    take_end(one, k, sampled);
  }
}

}  // namespace bromwich
