#include "bench/studies/derivative_check.hpp"

#include "bench/studies/derivative_changes.hpp"
#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/separable.hpp"
#include "core/solve/solve.hpp"
#include "derivatives/galerkin_derivative.hpp"
#include "derivatives/modal_derivative.hpp"
#include "derivatives/space_time_derivative.hpp"
#include "derivatives/switched_derivative.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich::app {

namespace {

constexpr Index largest_dense = 400;   ///< states that are written out
constexpr double largest_step = 1e-5;  ///< of a difference, relative: its error is 1e-10
constexpr double within_reach = 0.3;   ///< of the change that leaves the active sets, to first order
constexpr double within_margin = 0.1;  ///< of the margin, of boundary-value problems
constexpr double located_steps[] = {1e-4, 1e-5, 1e-6, 1e-7};
constexpr double most_noise = 1e-2;  ///< differences with more say nothing
constexpr int most_halved = 4;       ///< times that T is halved where they do
constexpr Index located_points = 64;
constexpr Index most_located = 64;  ///< states

double dot(const RowMatrix& a, const RowMatrix& b) {
  return a.size() > 0 && b.size() > 0 ? a.cwiseProduct(b).sum() : 0;
}

// <J^T u, v> of a gradient and a change.
double product(const DataChange& a, const DataChange& b) {
  double sum = a.x0.size() > 0 && b.x0.size() > 0 ? a.x0.dot(b.x0) : 0;
  sum += dot(a.f, b.f) + dot(a.g, b.g) + (a.b.size() > 0 && b.b.size() > 0 ? a.b.dot(b.b) : 0);
  for (const auto member : {&DataChange::A, &DataChange::B, &DataChange::N, &DataChange::M, &DataChange::E,
                            &DataChange::E0, &DataChange::ET})
    if ((a.*member).size() > 0 && (b.*member).size() > 0) sum += (a.*member).cwiseProduct(b.*member).sum();
  return sum;
}

// Whether a gradient has all members of a change.
bool covers(const DataChange& gradient, const DataChange& change) {
  bool all = gradient.x0.size() >= change.x0.size() && gradient.b.size() >= change.b.size();
  for (const auto member : {&DataChange::f, &DataChange::g})
    all = all && (gradient.*member).size() >= (change.*member).size();
  for (const auto member : {&DataChange::A, &DataChange::B, &DataChange::N, &DataChange::M, &DataChange::E,
                            &DataChange::E0, &DataChange::ET})
    all = all && (gradient.*member).size() >= (change.*member).size();
  return all;
}

using Jvp = std::function<SolutionChange(const DataChange&)>;
using Vjp = std::function<DataChange(const SolutionChange&)>;

// Largest |found - difference| over the largest of all, of columns of the same kind.
double largest_deviation(const RowMatrix& found, const RowMatrix& difference) {
  if (found.size() == 0 || difference.size() == 0) return 0;
  const double size = std::max(found.cwiseAbs().maxCoeff(), difference.cwiseAbs().maxCoeff());
  return size > 0 ? (found - difference).cwiseAbs().maxCoeff() / size : 0;
}

double largest(const RowMatrix& values) { return values.size() > 0 ? values.cwiseAbs().maxCoeff() : 0; }

// The largest |change| over the largest value.
double relative_change(const RowMatrix& change, const RowMatrix& values) {
  return largest(values) > 0 ? largest(change) / largest(values) : 0;
}

// The largest multiple of the change of y and w to first order that leaves the active sets. Entries with w = 0 that
// does not change are left out.
double reach(const RowMatrix& y, const RowMatrix& w, const SolutionChange& by) {
  double least = INFINITY;
  const double none = 1e-12 * (largest(w) + 1e-290);
  for (Index k = 0; k < y.size(); ++k) {
    const bool active = y.data()[k] > 0;
    const double value = active ? y.data()[k] : w.data()[k], change = std::abs((active ? by.y : by.w).data()[k]);
    if (change > 0 && (value > none || change > 1e-12 * largest(by.w)))
      least = std::min(least, std::max(value, 0.0) / change);
  }
  return least;
}

void check_identity(const SolutionChange& out, const Change& c, const Vjp& vjp, const std::vector<Index>& left_out,
                    Drawing& draw, DerivativeCheck& check) {
  SolutionChange of;
  const auto weigh = [&](const RowMatrix& values, RowMatrix& weights) {
    if (values.size() == 0) return;
    weights = draw.matrix(values.rows(), values.cols());
    for (const Index j : left_out) weights.row(j).setZero();
  };
  weigh(out.y, of.y);
  weigh(out.x, of.x);
  weigh(out.w, of.w);
  try {
    const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w);
    double size = 0;
    for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::w})
      size += (of.*member).norm() * (out.*member).norm();
    const DataChange gradient = vjp(of);
    if (!covers(gradient, c.data)) {
      check.refused["vjp by " + c.name] = "only some changes of it have a derivative";
      return;
    }
    const double off = std::abs(forward - product(gradient, c.data)) / std::max(size, 1e-290);
    check.identity = std::fmax(check.identity, off);
  } catch (const Error& refusal) {
    check.refused["vjp"] = refusal.what();
  }
}

Options options_of(Method method, Index steps) {
  Options options;
  options.method = method;
  options.steps = steps;
  options.states = StateSelection::all;
  options.trace = true;
  return options;
}

// w of the solution where it is known, to choose a step that keeps the sets.
struct Discrete {
  Result result;
  Jvp jvp;
  Vjp vjp;
  double margin = 0;
};

Discrete discrete_of(const Scene& scene, Backend& backend, Index steps, std::string& kind) {
  Discrete d;
  d.result = solve(scene, backend, options_of(scene.boundary ? Method::galerkin : Method::march, steps));
  if (scene.boundary) {
    const auto of = std::make_shared<GalerkinDerivative>(scene, d.result);
    d.jvp = [of](const DataChange& c) { return of->jvp(c); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "boundary";
  } else if (scene.dynamics->small_state()) {
    const auto of = std::make_shared<SolutionDerivative>(scene, d.result);
    d.jvp = [of](const DataChange& c) { return of->jvp(c); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "discrete";
  } else if (scene.dynamics->modes()) {
    const auto of = std::make_shared<ModalDerivative>(scene, d.result);
    d.jvp = [of](const DataChange& c) { return of->jvp(c, true); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "in modes";
  } else {
    const auto of = std::make_shared<SpaceTimeDerivative>(scene, d.result, backend);
    d.jvp = [of](const DataChange& c) { return of->jvp(c, true); };
    d.vjp = [of](const SolutionChange& c) { return of->vjp(c); };
    d.margin = of->margin().margin;
    kind = "over all times";
  }
  return d;
}

struct Difference {
  RowMatrix y, x;
};

Difference difference(const Change& c, double step, const Result& at, Backend& backend) {
  const Options options = options_of(at.method, at.steps);
  const Result up = solve(c.scene(step), backend, options), down = solve(c.scene(-step), backend, options);
  if (up.status != Status::solved || down.status != Status::solved)
    throw Error("derivative", "a scene with changed data is not solved", "another change");
  return {(up.y - down.y) / (2 * step), (up.x - down.x) / (2 * step)};
}

void compare_discrete(const Scene& scene, Backend& backend, const Discrete& d, Drawing& draw, DerivativeCheck& check) {
  const Vector& t = d.result.t;
  std::vector<Change> changes = changes_of_any(scene, t, !scene.dynamics->small_state(), draw);
  if (scene.dynamics->small_state()) add_matrices(scene, draw, changes);
  RowMatrix w = d.result.y * to_dense(scene.M).transpose();
  w +=
      d.result.trace.size() > 0 ? d.result.trace : RowMatrix(d.result.x * scene.dynamics->small_state()->N.transpose());
  if (scene.g && scene.constraints() > 0) w += sample(scene.g, t, scene.constraints()).table();
  for (const Change& c : changes) try {
      const SolutionChange out = d.jvp(c.data);
      const double relative = std::max({relative_change(out.y, d.result.y), relative_change(out.x, d.result.x),
                                        relative_change(out.w, w), c.linear ? 1e-12 : 1.0});
      // Of boundary values the moments of y and w are complementary, not their values at the time points.
      const double keeps =
          scene.boundary ? within_margin * d.margin / relative : within_reach * reach(d.result.y, w, out);
      const double step = std::min(keeps, largest_step / relative);
      if (!(step > 0)) throw Error("derivative", "y = w = 0 at a time point", "another grid");
      const Difference one = difference(c, step, d.result, backend), other = difference(c, step / 2, d.result, backend);
      check.error[c.name] = std::max(largest_deviation(out.y, one.y), largest_deviation(out.x, one.x));
      check.noise[c.name] = std::max(largest_deviation(other.y, one.y), largest_deviation(other.x, one.x));
      check_identity(out, c, d.vjp, {}, draw, check);
    } catch (const Error& refusal) {
      check.refused[c.name] = refusal.what();
    }
}

// Whether t is at a switch of one of the three, or between those of different ones.
bool moves_over(double t, const std::vector<double>& a, const std::vector<double>& b, const std::vector<double>& c) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (t >= std::min({a[i], b[i], c[i]}) - 1e-9 && t <= std::max({a[i], b[i], c[i]}) + 1e-9) return true;
  return false;
}

double located_error(const SwitchedDerivative& d, const SolutionChange& out, const Change& c, double step) {
  const SwitchedDerivative up(c.scene(step), d.times(), true), down(c.scene(-step), d.times(), true);
  if (up.switches().size() != d.switches().size() || down.switches().size() != d.switches().size()) return INFINITY;
  double worst = 0;
  for (const auto member : {&SolutionChange::y, &SolutionChange::x, &SolutionChange::integral}) {
    RowMatrix found = out.*member, difference = (up.values().*member - down.values().*member) / (2 * step);
    for (Index j = 0; j < d.times().size(); ++j)
      if (moves_over(d.times()[j], d.switches(), up.switches(), down.switches()))
        found.row(j) = difference.row(j) = RowMatrix::Zero(1, found.cols());
    worst = std::max(worst, largest_deviation(found, difference));
  }
  return worst;
}

void check_located(const Scene& scene, Drawing& draw, DerivativeCheck& check) {
  const Vector t = time_grid(scene.T, located_points);
  const SwitchedDerivative d(scene, t, true);
  check.kind = "located";
  check.steps = Index(d.switches().size());
  check.margin = std::min(d.margin().margin, d.margin().transversality);
  std::vector<Change> changes = changes_of_any(scene, t, false, draw);
  add_matrices(scene, draw, changes);
  const Vjp vjp = [&d](const SolutionChange& of) { return d.vjp(of); };
  for (const Change& c : changes) {
    try {
      const SolutionChange out = d.jvp(c.data);
      double best = INFINITY;
      for (const double step : located_steps) try {
          best = std::min(best, located_error(d, out, c, step));
        } catch (const Error&) {
        }  // the changed scene has no derivative: a smaller step
      if (!std::isfinite(best))
        throw Error("differences", "other switches with every change, so that none compares", "");
      check.error[c.name] = best;
      check_identity(out, c, vjp, d.one_sided(), draw, check);
    } catch (const Error& refusal) {
      check.refused[c.name] = refusal.what();
    }
  }
}

}  // namespace

double DerivativeCheck::largest_error() const {
  double largest = 0;
  for (const auto& [name, e] : error) largest = std::fmax(largest, std::isnan(e) ? INFINITY : e);
  return largest;
}

double DerivativeCheck::largest_noise() const {
  double largest = 0;
  for (const auto& [name, e] : noise) largest = std::fmax(largest, e);
  return largest;
}

Verdict DerivativeCheck::verdict() const {
  const double tolerance = kind == "located" ? expected_located : expected_discrete;
  Verdict found = error.empty() ? Verdict::undecided : Verdict::agrees;
  for (const auto& [name, e] : error) {
    if (e <= tolerance) continue;
    const auto own = noise.find(name);
    if (own == noise.end() || !(e <= 10 * own->second)) return Verdict::differs;
    found = Verdict::undecided;
  }
  return found;
}

namespace {

// With located switches after the discrete derivative was refused: sources that jump or bend inside steps, or y = w = 0
// on all grids.
void check_located_instead(const Scene& scene, Drawing& draw, DerivativeCheck& check) {
  const std::string why = check.reason;
  check.kind.clear();
  if (scene.states() > most_located) return;
  try {
    check_located(scene, draw, check);
    check.reason.clear();
  } catch (const Error& refusal) {
    check.kind.clear();
    check.reason = why + "; and with located switches: " + refusal.what();
  }
}

void check_once(const Scene& scene, Backend& backend, Index steps, Index grids, DerivativeCheck& check) {
  Drawing draw;
  if (!scene.boundary) {
    const Result first = solve(scene, backend, options_of(Method::march, steps));
    if (first.status == Status::solved && y_may_jump(first)) return check_located(scene, draw, check);
  }
  std::optional<Discrete> best;
  for (Index more = 0; more < grids; ++more) try {
      Discrete d = discrete_of(scene, backend, steps + more, check.kind);
      if (!best || d.margin > best->margin) best = std::move(d);
    } catch (const Error& refusal) {
      check.reason = refusal.what();
    }
  if (!best && scene.boundary) return;
  if (!best) return check_located_instead(scene, draw, check);
  check.reason.clear();
  check.steps = best->result.steps;
  check.margin = best->margin;
  compare_discrete(scene, backend, *best, draw, check);
}

}  // namespace

DerivativeCheck check_derivatives(const Scene& given, Backend& backend, Index steps, Index grids) {
  DerivativeCheck check;
  try {
    // Known without a solve, which takes minutes in some of these.
    const bool may_jump = !is_continuous(known_class(given.M, given.lcp_class)) ||
                          (given.constraints() > 0 && diagonal(given.M).minCoeff() <= 0);
    if (may_jump && given.states() > most_located)
      throw Error("derivative", text("y may jump, and the scene has more than %ld states", long(most_located)),
                  "differentiate smaller ones with located switches");
    Scene scene = given;
    if (scene.states() <= largest_dense && scene.dynamics->dense_form()) scene = written_out(scene);
    for (int halved = 0; halved <= most_halved; ++halved) {
      check = {};
      check.T = scene.T;
      check_once(scene, backend, steps, grids, check);
      if (check.largest_noise() <= most_noise) break;
      scene.T /= 2;
      steps = std::max<Index>(1, steps / 2);
    }
  } catch (const Error& refusal) {
    check = {};
    check.reason = refusal.what();
  }
  check.states = given.states();
  check.constraints = given.constraints();
  return check;
}

}  // namespace bromwich::app
