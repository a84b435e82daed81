#include "core/solve.hpp"

#include "core/certificate.hpp"
#include "core/cost.hpp"
#include "core/error.hpp"
#include "core/methods.hpp"
#include "core/states.hpp"
#include "core/timer.hpp"
#include "core/windows.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace bromwich {

namespace {

constexpr std::array<std::pair<Method, const char*>, 5> method_names{{
    {Method::automatic, "auto"},
    {Method::contour, "contour"},
    {Method::contour_literal, "contour-literal"},
    {Method::march, "march"},
    {Method::euler, "euler"},
}};

constexpr Index most_steps = Index(1) << 24;

void validate(const Scene& scene, const Options& options) {
  if (options.steps < 0 || options.steps > most_steps)
    throw Error("steps", "found " + std::to_string(options.steps), "give a whole number from 1 to 16777216");
  if (!(options.iteration_tolerance > 0) || !(options.iteration_tolerance < 1))
    throw Error("iteration_tolerance", "found " + std::to_string(options.iteration_tolerance),
                "give a number between 0 and 1");
  if (options.max_iterations < 1)
    throw Error("max_iterations", "found " + std::to_string(options.max_iterations), "give at least 1");
  if (options.literal_nodes < 2 || options.literal_nodes > 400)
    throw Error("literal_nodes", "found " + std::to_string(options.literal_nodes), "give 2 to 400");
  for (const Index c : options.components)
    if (c < 0 || c >= scene.states())
      throw Error("states", "component " + std::to_string(c) + " of " + std::to_string(scene.states()),
                  "components are counted from 0");
}

// The natural-map residual that a solution may have: rounding of the kernel, and what an iteration tolerance leaves
// open.
double residual_limit(bool iterated, const Options& options) {
  return iterated ? std::clamp(1e3 * options.iteration_tolerance, 1e-9, 1e-2) : 1e-9;
}

bool iterates(Method method) { return method == Method::contour || method == Method::contour_literal; }

template <class... Args>
std::string text(const char* format, Args... args) {
  char buffer[224];
  std::snprintf(buffer, sizeof buffer, format, args...);
  return buffer;
}

void demote(Result& result, const std::string& reason) {
  result.status = Status::tolerance_not_met;
  result.reason = reason;
}

// One run of a scene: its methods on the grid asked for, and on finer ones where a result has to be confirmed.
class Run {
 public:
  Run(Methods& methods, Backend& backend, const Options& options)
      : methods_(methods), backend_(backend), options_(options) {}

  void named(Method method, Result& result) {
    methods_.run(method, options_, result);
    if (iterates(method) && result.infeasible_at && result.status == Status::tolerance_not_met)
      confirm_by_marching(result);
    else if (iterates(method) && result.status != Status::infeasible)
      result.infeasible_at.reset();
    if (result.status == Status::infeasible && result.infeasible_at.value_or(0) > 0) confirm_infeasible(result);
    if (result.status == Status::solved) certify(method, result);
  }

  // Marching costs less than a few sweeps of the iteration on these backends. Where it does not fit into memory, or a
  // step cannot be solved (M + W_0 may leave the class of M), the iteration, which only ever needs M, and implicit
  // Euler are tried, in this order.
  void automatic(Result& result) {
    const DiscreteProblem& p = methods_.problem();
    if (p.kronecker() && p.scene.constraints() > largest_marched && iterate_first(result)) return;
    std::string before;
    for (const Method method : {Method::march, Method::contour, Method::euler}) {
      if (const std::string why = against(method); !why.empty()) {
        before += std::string("; not ") + to_string(method) + ": " + why;
        continue;
      }
      Result next;
      next.seconds.setup = result.seconds.setup;
      named(method, next);
      // Implicit Euler, the last resort, is too inexact to prove that there is no solution where the others did not.
      const bool ended = next.status != Status::tolerance_not_met && next.status != Status::unsupported &&
                         (method != Method::euler || next.status != Status::infeasible);
      const std::string reason = next.reason;
      if (ended || result.reason.empty()) {  // of several failures the first is the one to explain
        result = std::move(next);
        if (ended) result.kernel += before;
      }
      if (ended || sensitive_) return;
      before += std::string("; not ") + to_string(method) + ": " + reason;
    }
  }

 private:
  // Above this many constraints the n x n problems of marching cost more than many sweeps; the iteration gets as many
  // as marching is predicted to cost.
  bool iterate_first(Result& result) {
    const DiscreteProblem& p = methods_.problem();
    const double march = predicted_cost(p.scene, Method::march, p.J, 0).operations;
    const double sweep = predicted_cost(p.scene, Method::contour, p.J, 0).operations / 100;
    Options limited = options_;
    limited.max_iterations = std::clamp<Index>(Index(march / sweep), 1, options_.max_iterations);
    Run run(methods_, backend_, limited);
    Result first;
    first.seconds.setup = result.seconds.setup;
    run.named(Method::contour, first);
    if (first.status != Status::solved && first.status != Status::infeasible) return false;
    first.kernel += "; taken before march, whose n x n problems cost more";
    result = std::move(first);
    return true;
  }
  static constexpr Index largest_marched = 1024;

  // What speaks against a method before it runs.
  std::string against(Method method) {
    const DiscreteProblem& p = methods_.problem();
    const Cost cost = predicted_cost(p.scene, method, p.J, Index(p.components.size()), backend_.device().threads);
    if (options_.memory_limit > 0 && cost.bytes > options_.memory_limit) return "it does not fit into memory";
    if (method != Method::contour || p.lcp_class == LcpClass::Z) return "";
    const std::optional<Forecast> f = iteration_forecast(p, options_.iteration_tolerance);
    if (f && f->longest_window(options_.iteration_tolerance) == 0)
      return text("its sweeps are not known to contract (kappa_0 = %.2g)", f->kappa0);
    return "";
  }

  // An infeasible iterate proves nothing about the scene; marching the same discretisation decides.
  void confirm_by_marching(Result& result) {
    const std::string observed = result.reason;
    Result marched;
    methods_.run(Method::march, options_, marched);
    result.infeasible_at.reset();
    if (marched.status == Status::infeasible) {
      result.status = Status::infeasible;
      result.reason = marched.reason + " (confirmed by marching)";
      result.infeasible_at = marched.infeasible_at;
      result.y = std::move(marched.y);
      result.x = std::move(marched.x);
      result.residual = marched.residual;
    } else if (marched.status == Status::solved) {
      result.reason = observed + ", but marching gets past it: use method march";
    } else {
      result.reason = observed + "; marching ends too: " + marched.reason;
    }
  }

  Result refined(Method method) {
    const DiscreteProblem& p = methods_.problem();
    Methods fine(p.scene, backend_, 2 * p.J, {});
    Result result;
    fine.run(method, options_, result);
    return result;
  }

  // A step without a solution ends the discrete problem. It says something about the scene only where the solution up
  // to there is one: with half the step the end has to stay where it is, and so has y.
  void confirm_infeasible(Result& result) {
    const DiscreteProblem& p = methods_.problem();
    const Method method = method_from_string(result.method);
    const Result fine = refined(iterates(method) ? Method::march : method);
    const double at = *result.infeasible_at;
    const Index last = std::max<Index>(Index(std::llround(at / p.h)) - 1, 0);
    const bool same_end = fine.status == Status::infeasible && std::abs(*fine.infeasible_at - at) <= 2 * p.h;
    if (same_end && (last == 0 || change_when_halved(result.y, fine.y, last).largest <= confirmed_change)) return;
    result.infeasible_at.reset();
    demote(result,
           text("the step to t = %.6g has no solution, but that changes with the step: not proven for the scene", at));
  }

  void certify(Method method, Result& result) {
    const DiscreteProblem& p = methods_.problem();
    if (!(result.residual <= residual_limit(iterates(method), options_)))
      return demote(result, "the residual is above the limit for a solution");
    if (method != Method::contour_literal && result.kernel_error > most_kernel_error)
      return demote(result, text("the weights of the kernel are known only to %.1e: use other steps, or method euler",
                                 result.kernel_error));
    if (const double missed = method == Method::contour_literal && p.dense() ? true_residual(result) : 0;
        !(missed <= most_literal_residual))
      return demote(
          result, text("with the states that y gives, complementarity fails by %.1e: its contours miss them", missed));
    const bool continuous = method != Method::euler && result.continuous;
    if (const Index j = continuous ? ringing_from(result.y) : -1; j >= 0)
      return demote(result,
                    text("y alternates between time points from t = %.6g on; use more steps or method euler", p.t[j]));
    const bool ringing = methods_.basis().rings;  // of continuous y, whatever the method
    const Magnification m = magnification(p, continuous ? Rule::exponential : Rule::implicit_euler, result.y);
    result.magnification = m.growth;
    if (m.rounding > most_rounding) {
      sensitive_ = true;
      return demote(result, text("the scene magnifies perturbations %.1e times up to T: rounding leaves no digit of y",
                                 m.growth));
    }
    if (m.impulse > strong_impulse && p.lcp_class == LcpClass::P && p.scene.states() <= Methods::most_recorded_states &&
        contact_frequency(p, result.y) * p.h > 1) {
      sensitive_ = true;
      return demote(result, "a contact throws the state back within less than a step: use more steps");
    }
    if (!result.well_posed)
      confirm_by_half_the_step(method, 1, "the problems of the steps may have several solutions", result);
    else if (ringing && m.growth > doubtful_growth_with_jumps)
      confirm_by_half_the_step(method, 1, text("the scene magnifies errors %.1e times", m.growth), result);
    else if (!ringing && m.growth > doubtful_growth && states_are_known(result))
      confirm_errors_stay_small(method, m, result);
    else if (!ringing && m.growth > doubtful_growth)
      confirm_by_half_the_step(method, 1, text("the scene magnifies errors %.1e times", m.growth), result);
    // With M of class P a contact is a spring, however stiff, and its rebound wants to be resolved. (With M = 0 an
    // impact is over at once, and nothing is to be resolved.)
    else if (m.impulse > unresolved_impulse && p.lcp_class == LcpClass::P && p.J >= fewest_steps_to_judge)
      confirm_by_half_the_step(method, continuous ? 5 : 1, "a constraint is active for a few steps only, and strongly",
                               result);
  }

  // Stages record the state only where it is small; continuous y gives it afterwards.
  bool states_are_known(const Result& result) const {
    return result.continuous || methods_.problem().scene.states() <= Methods::most_recorded_states;
  }

  // The natural map with N x of the states that y gives by the matrix exponential: contours of the method itself do not
  // enter.
  double true_residual(const Result& result) const {
    const DiscreteProblem& p = methods_.problem();
    const RowMatrix q = methods_.all_states(Method::march, result) * p.dense()->N.transpose() + p.g;
    const RowMatrix w = q + result.y * to_dense(p.scene.M).transpose();
    double worst = 0;
    for (Index j = 0; j <= p.J; ++j)
      worst = std::max(worst, result.y.row(j).cwiseMin(w.row(j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() /
                                  std::max(1.0, q.row(j).cwiseAbs().maxCoeff()));
    return worst;
  }

  Result with_half_the_step(Method method, Methods& half) {
    Result fine;
    half.run(method, options_, fine);
    return fine;
  }

  // A scene that magnifies errors: those of the steps, seen in the first steps against half the step, may not add up to
  // the size of the state, and nowhere may the two runs part.
  void confirm_errors_stay_small(Method method, const Magnification& m, Result& result) {
    const DiscreteProblem& p = methods_.problem();
    Methods half(p.scene, backend_, 2 * p.J, {});
    const Result fine = with_half_the_step(method, half);
    Divergence d{INFINITY, INFINITY};
    if (fine.status == Status::solved)
      d = divergence(methods_.all_states(method, result), half.all_states(method, fine), m.scale);
    if (d.pointwise <= most_divergence && d.defect * m.condition <= most_predicted_error) return;
    sensitive_ = true;
    demote(result,
           text("the scene magnifies errors %.1e times, and those of the steps then fill the result", m.growth) +
               "; use more steps");
  }

  // A step may have several solutions, or see a contact hardly at all: with half the step the same must come out, up to
  // what a step of this size may miss. y is compared by its integral, so that impulses are.
  void confirm_by_half_the_step(Method method, double slack, const std::string& why, Result& result) {
    const DiscreteProblem& p = methods_.problem();
    Methods half(p.scene, backend_, 2 * p.J, {});
    const Result fine = with_half_the_step(method, half);
    bool same = fine.status == Status::solved;
    if (same) {
      const Change y = change_when_halved(running_integral(result.y, p.h), running_integral(fine.y, p.h / 2), p.J);
      same = y.mean <= slack * most_mean_change;
    }
    if (same && p.dense() && p.scene.states() <= Methods::most_recorded_states) {
      const Change x = change_when_halved(methods_.all_states(method, result), half.all_states(method, fine), p.J);
      same = x.mean <= slack * most_mean_change && x.typical <= slack * most_typical_change;
    }
    if (!same && slack > 1) sensitive_ = true;
    if (!same)
      demote(result, why + ", and with half the step another result comes out; use more steps or another method");
  }

  static constexpr double most_kernel_error = 1e-6;  ///< two ways to the same weights, relative to the largest
  static constexpr double most_literal_residual =
      0.2;  ///< few nodes miss by a few hundredths, a contour through the spectrum by 1
  static constexpr double most_rounding = 1e-4;   ///< of the state, left by rounding
  static constexpr double doubtful_growth = 100;  ///< of perturbations: an error of one step may fill the result
  static constexpr double doubtful_growth_with_jumps = 1e4;  ///< the same where a position held moves a velocity by 1/h
  static constexpr double most_divergence = 0.1;             ///< of the state, between a step and half of it
  static constexpr double most_predicted_error = 0.5;        ///< of the state
  static constexpr Index fewest_steps_to_judge = 32;         ///< on coarser grids every contact is short
  static constexpr double strong_impulse = 0.3;              ///< of the state, by a contact that may be a spring
  static constexpr double unresolved_impulse = 0.1;    ///< of the state, in a step in which the active set changes
  static constexpr double most_mean_change = 0.1;      ///< of y and x with half the step, where that is looked at
  static constexpr double most_typical_change = 0.05;  ///< of x at 95 of 100 time points
  static constexpr double confirmed_change = 0.05;     ///< of y before a step without a solution

  bool sensitive_ = false;  ///< the scene itself magnifies errors: no method of lower order will do better
  Methods& methods_;
  Backend& backend_;
  const Options& options_;
};

bool finite_sources(const DiscreteProblem& p, Result& result) {
  for (const auto& [values, name] : {std::pair(&p.f, "f"), std::pair(&p.g, "g")}) {
    for (Index j = 0; j < values->rows(); ++j) {
      if (values->row(j).allFinite()) continue;
      result.status = Status::nonfinite;
      result.reason = std::string(name) + " is not finite at t = " + std::to_string(p.t[j]);
      return false;
    }
  }
  return true;
}

std::vector<Index> selected(const Scene& scene, const Options& options) {
  if (options.states == StateSelection::list) return options.components;
  std::vector<Index> all(options.states == StateSelection::all ? std::size_t(scene.states()) : 0);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = Index(i);
  return all;
}

}  // namespace

const char* to_string(Method method) {
  for (const auto& [value, name] : method_names)
    if (value == method) return name;
  return "unknown";
}

Method method_from_string(const std::string& name) {
  std::string known;
  for (const auto& [value, text] : method_names) {
    if (name == text) return value;
    known += std::string(known.empty() ? "" : ", ") + text;
  }
  throw Error("method", "found '" + name + "'", "use one of " + known);
}

namespace {

// Below this size dense matrices are faster in everything, and e^{hA} needs no contour.
constexpr Index smallest_sparse = 512;

}  // namespace

Result solve(const Scene& given, Backend& backend, const Options& options) {
  Timer total;
  given.validate();
  validate(given, options);
  std::optional<Scene> written_out;
  if (std::holds_alternative<SparseDynamics>(given.dynamics) && given.states() <= smallest_sparse) {
    written_out = given;
    written_out->dynamics = to_dense(given.dynamics);
  }
  const Scene& scene = written_out ? *written_out : given;
  Result result;
  result.method = to_string(options.method);
  const Index J = options.steps > 0 ? options.steps : scene.default_steps;
  const std::vector<Index> components = selected(scene, options);
  refuse_what_does_not_fit(scene, options, J, Index(components.size()), backend.device().threads);
  Methods methods(scene, backend, J, components);
  const DiscreteProblem& p = methods.problem();
  result.seconds.setup = Timer(total).lap();
  if (finite_sources(p, result)) {
    Run run(methods, backend, options);
    if (options.method == Method::automatic)
      run.automatic(result);
    else
      run.named(options.method, result);
  }
  result.backend = backend.name();
  result.t = p.t;
  result.steps = J;
  if (result.y.size() == 0) result.y = RowMatrix::Constant(J + 1, scene.constraints(), NAN);
  if (result.x.rows() != J + 1) result.x = RowMatrix::Constant(J + 1, Index(components.size()), NAN);
  if (result.status == Status::infeasible && result.infeasible_at == 0.0) result.y.setConstant(NAN);
  result.x_components = components;
  Seconds& s = result.seconds;
  s.total = total.lap();
  s.solve = s.total - s.setup;
  s.other = std::max(0.0, s.solve - s.lcp - s.convolution - s.transform);
  return result;
}

Matrix states_at(const Scene& scene, Backend& backend, const Result& result, const std::vector<Index>& rows) {
  scene.validate();
  if (result.y.rows() != result.steps + 1 || result.y.cols() != scene.constraints())
    throw Error("result", "its y does not have one row per time point and one column per constraint",
                "pass a result of this scene");
  if (result.method == to_string(Method::euler) || !result.continuous)
    throw Error("result", "its y is not linear between time points", "ask for states when solving");
  Index last = 0;
  for (const Index j : rows) {
    if (j < 0 || j > result.steps)
      throw Error("rows", "found " + std::to_string(j), "rows are time points 0.." + std::to_string(result.steps));
    last = std::max(last, j);
  }
  if (!result.y.topRows(last + 1).allFinite())
    throw Error("rows", "the result is not valid up to row " + std::to_string(last), "ask for earlier rows");
  return states_at_rows(discretise(scene, backend, result.steps), result.y, rows);
}

}  // namespace bromwich
