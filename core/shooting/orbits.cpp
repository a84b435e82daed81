#include "core/shooting/orbits.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/events/collocation.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/shooting/divided_shooting.hpp"
#include "core/shooting/extremes.hpp"
#include "core/shooting/flow_derivative.hpp"
#include "core/shooting/located_shooting.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double nearer = 1e-2;  ///< of differences: where longer ones lead to other forms

double end_of(const EventPiece& p) { return std::min(1.0, (p.end - p.begin) / p.length); }

}  // namespace

OrbitForm form_of(const EventSolution& s, Index n) {
  OrbitForm form(std::size_t(n), 0);
  for (Index i = 0; i < n; ++i) {
    const auto is_active = [i](const EventPiece& p) { return std::binary_search(p.active.begin(), p.active.end(), i); };
    bool active = is_active(s.pieces.back());
    Index bounces = 0, &count = form[std::size_t(i)];
    for (const EventPiece& p : s.pieces) {
      if (p.passed) continue;
      const bool now = is_active(p), struck = std::any_of(p.impulses.begin(), p.impulses.end(),
                                                          [i](const EventImpulse&j) { return j.p[i] > 0; });
      if (now && !active) ++count;
      if (struck && !now && !active) ++bounces;
      if (now) bounces = 0;
      active = now;
    }
    count += bounces;
  }
  return form;
}

Index growing(const std::vector<Complex>& multipliers) {
  constexpr double rounding = 1e-6;
  return std::count_if(multipliers.begin(), multipliers.end(), [](Complex z) { return std::abs(z) > 1 + rounding; });
}

BranchPoint point_of(const Orbit& o) {
  BranchPoint point;
  point.parameter = o.p;
  point.T = o.scene->T;
  point.x0 = o.x0;
  point.least = point.largest = o.x0;
  for (const EventPiece& p : o.flow.pieces)
    for (Index i = 0; i < o.x0.size(); ++i) {
      const Extremes here = extremes_of(p.x.col(i), end_of(p));
      point.least[i] = std::min(point.least[i], here.least);
      point.largest[i] = std::max(point.largest[i], here.largest);
    }
  point.multipliers = multipliers_of(o.D);
  point.stable = growing(point.multipliers) == 0;
  point.impacts = o.flow.jumps;
  return point;
}

Orbits::Orbits(const std::function<Scene(double)>& scene_of, double from, double to, const ContinuationOptions& options)
    : scene_of_(scene_of), from_(from), to_(to), options_(options) {}

Orbits::Stated Orbits::stated(double p) {
  Scene scene = scene_of_(p);
  scene.validate();
  const std::string at = text("the scene of %.6g ", p);
  if (!scene.boundary || !is_periodic(*scene.boundary))
    throw Error("scene_of", at + "has no periodic condition", "give scenes with x(0) = x(T)");
  if (states_ < 0) states_ = scene.states();
  if (scene.states() != states_)
    throw Error("scene_of", at + text("has %ld states, and others have %ld", long(scene.states()), long(states_)),
                "give scenes that differ in values alone");
  scene.no_pulses = scene.no_pulses || scene.breakpoints_are_all;
  Stated s{std::make_shared<Scene>(with_all_breakpoints(std::move(scene))), {}, {}};
  s.condition = *s.scene->boundary;
  s.scene->boundary.reset();
  s.scene->x0 = Vector::Zero(states_);
  if (const std::string why = unsuited_to_events(*s.scene); !why.empty())
    throw Error("scene_of", at + "is not suited to located events: " + why, "give smaller scenes with dense dynamics");
  s.lcp_class = selection_class(s.scene->M, s.scene->lcp_class);
  return s;
}

std::optional<Orbit> Orbits::first() {
  Stated s = stated(from_);
  s.scene->boundary = s.condition;
  ShootingOptions o;
  o.events.tolerance = options_.tolerance;
  o.events.interrupted = options_.interrupted;
  o.start = options_.x0;
  const ShootingSolution found = shoot_on_events(*s.scene, s.lcp_class, s.scene->breakpoints, o);
  integrations_ += found.flows;
  if (!found.found) {
    why_ = text("no periodic state was found at %.6g: ", from_) + found.reason;
    return std::nullopt;
  }
  return from(found.x0, from_);
}

std::optional<Orbit> Orbits::from(const Vector& x0, double p, bool with_derivative) {
  const Stated s = stated(p);
  Orbit o{p, s.scene, s.condition, {}, x0};
  EventOptions options;
  options.tolerance = options_.tolerance;
  options.longest_step = s.scene->T / 16;
  options.interrupted = options_.interrupted;
  const auto flow = [&] {
    s.scene->x0 = o.x0;
    ++integrations_;
    o.flow = integrate_closely(*s.scene, s.lcp_class, s.scene->breakpoints, options);
    return o.flow.complete;
  };
  if (!x0.allFinite()) return std::nullopt;
  if (!flow()) {
    o.x0 = nearest_feasible(*s.scene, x0, x0.cwiseAbs().cwiseMax(1e-3 * x0.cwiseAbs().maxCoeff()));
    if (o.x0 == x0 || !flow()) {
      why_ = o.flow.reason;
      return std::nullopt;
    }
  }
  o.size = largest_values(o.flow, &EventPiece::x);
  o.F = o.condition.E0 * o.x0 + o.condition.ET * end_of_flow(o.flow) - o.condition.b;
  if (with_derivative) o.D = FlowDerivative(*s.scene).at_end(o.flow);
  o.form = form_of(o.flow, s.scene->constraints());
  if (o.D.allFinite() && o.F.allFinite()) return o;
  why_ = "changes of x(0) grow without bounds";
  return std::nullopt;
}

std::optional<Vector> Orbits::by_parameter(const Orbit& o, const Vector& along) {
  const Index m = o.x0.size();
  const Vector of_x = (o.condition.E0 + o.condition.ET * o.D) * along.head(m);
  std::optional<Vector> slope;
  for (const double share : {1.0, -1.0, nearer, -nearer}) {
    const auto there = from(o.x0 + share * along.head(m), o.p + share * along[m], false);
    if (!there) continue;
    if (!slope || there->form == o.form) slope = ((there->F - o.F) / share - of_x) / along[m];
    if (there->form == o.form) break;
  }
  return slope;
}

}  // namespace bromwich
