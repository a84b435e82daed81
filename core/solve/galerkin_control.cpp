#include "core/solve/galerkin_control.hpp"

#include "core/accuracy/convergence.hpp"
#include "core/base/text.hpp"
#include "core/certificate/certificate.hpp"
#include "core/galerkin/galerkin.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/beside_march.hpp"
#include "core/solve/certification.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/methods.hpp"

#include <algorithm>
#include <string>

namespace bromwich {

namespace {

constexpr double seen_beside_march = 0.01;  ///< of the mean of y or x: a difference above that is reported
constexpr double seen_in_rows = 0.1;        ///< of y at single time points

// Whether y moves the state, or the state itself, within a part of an interval.
bool has_fast_layers(const Scene& scene, Index J) {
  const DenseDynamics* d = scene.dynamics->small_state();
  return d && !scene.boundary && scene.T / double(J) * d->A.cwiseAbs().rowwise().sum().maxCoeff() > 1;
}

// y is linear inside an interval. Where sources jump or go up and down there (moments follow f and g), or the state is
// faster, method march, which takes such steps in parts or damps them, says how much that matters.
bool compare_with_march(const Scene& scene, Backend& backend, const InnerOptions& options, const RowMatrix& x,
                        Result& result) {
  if (!scene.free_rows.empty()) return false;
  const bool layers = result.rough_steps == 0;
  if (layers && !has_fast_layers(scene, result.steps)) return false;
  if (scene.boundary && !Methods::has_small_dense_state(scene)) return false;  // all states are needed in between
  const Result march = beside_march(scene, backend, options, result, x);
  if (march.status != Status::solved) return false;  // the states of the result need not be those that march allows
  const Distance d = distance(march, 1, result, 1, ComponentSizes{});
  if (!layers) result.unresolved_sources = std::max(d.mean, d.of_x());
  const bool of_mean = layers || d.y <= seen_in_rows;
  if (std::max(d.mean, d.of_x()) > seen_beside_march || !of_mean)
    judge_errors({d.of_x(), of_mean ? d.mean : d.y, of_mean}, result);
  return !layers;
}

// Without such a comparison, g that changes fast is named; stated jumps have intervals with a rule of their own.
void note_fast_g(const Scene& scene, Result& result) {
  if (!scene.g || result.status != Status::solved) return;
  const SampledSource g = sample(scene.g, result.t, scene.constraints());
  const SourceSteps s = find_source_steps(scene, result.t, SampledSource(), g, false);
  if (s.unresolved == 0 && (s.disagreement_of_g == 0 || !scene.breakpoints.empty())) return;
  result.unresolved_sources = std::max(s.disagreement, s.disagreement_of_g);
  result.rough_steps = Index(s.rough.size());
  tell_sources(result.unresolved_sources, s.time, result);
}

}  // namespace

Result by_galerkin(const Scene& scene, Backend& backend, const InnerOptions& options) {
  const Index J = steps_of(scene, options);
  const Cost cost = refuse_what_does_not_fit(scene, options, J, Index(recorded_components(scene, options).size()));
  InnerOptions one = options;
  const bool judged = !options.compares_grids && Methods::has_small_dense_state(scene);  // by all states
  if (judged) one.states = StateSelection::all;
  Result result = solve_by_galerkin(scene, backend, one);
  RowMatrix x;
  if (judged) {
    x = std::move(result.x);
    result.x_components = recorded_components(scene, options);
    result.x = x(Eigen::all, result.x_components);
  }
  result.bytes_predicted = std::size_t(cost.bytes);
  const bool alone = !options.event_location && !options.compares_grids && result.status == Status::solved;
  if (alone && options.confirm && !scene.boundary) {
    result.certificate = certify(scene, result, find_breakpoints(scene), x);
    if (result.certificate) {
      take_certificate(result);
      return result;
    }
  }
  if (alone && compare_with_march(scene, backend, options, x, result)) return result;
  if (!options.event_location) note_fast_g(scene, result);
  return result;
}

}  // namespace bromwich
