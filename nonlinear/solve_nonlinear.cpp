#include "nonlinear/solve_nonlinear.hpp"

#include "core/accuracy/magnification.hpp"
#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/result/notice.hpp"
#include "core/result/options.hpp"
#include "core/scene/coarse_sources.hpp"
#include "nonlinear/adapted_nonlinear.hpp"
#include "nonlinear/divided_step.hpp"
#include "nonlinear/doubts.hpp"
#include "nonlinear/nonlinear_run.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

// The largest difference at the points of the coarser grid, each component relative to its largest value, or to 1e-3 of
// the largest of its kind.
double apart(const RowMatrix& coarse, const RowMatrix& fine) {
  double largest = 0;
  if (fine.size() == 0) return 0;
  const double all = fine.cwiseAbs().maxCoeff();
  for (Index i = 0; i < coarse.cols(); ++i) {
    double difference = 0, size = 1e-3 * all;
    for (Index j = 0; j < coarse.rows(); ++j) {
      difference = std::max(difference, std::abs(coarse(j, i) - fine(2 * j, i)));
      size = std::max(size, std::abs(fine(2 * j, i)));
    }
    if (difference > 0) largest = std::max(largest, difference / size);
  }
  return largest;
}

// Methods for the linear solves of windows: those with y linear between the time points.
bool solves_the_discrete_problem(Method inner) {
  return inner == Method::automatic || inner == Method::march || inner == Method::contour || inner == Method::multigrid;
}

// What phi and gamma see.
const RowMatrix& seen(const NonlinearResult& r) { return r.trace.size() > 0 ? r.trace : r.x; }

constexpr int most_failures = 6;  // grids in turn that are not solved
constexpr double most_unordered =
    10;  // of differences that do not fall, to the tolerance: rounding, or what only rough steps see

// The error of the finest of three grids from their two differences; nothing where they do not say it.
std::optional<double> error_of(double before, double now, double wanted) {
  const double order = std::clamp(std::log2(before / std::max(now, 1e-300)), 0.0, 2.0);
  if (order >= 0.5) return now / (std::exp2(order) - 1);
  const double bound = most_unordered * std::max(before, now);
  return bound <= wanted ? std::optional(bound) : std::nullopt;
}

// The integral of y by the quadrature of the steps.
RowMatrix integral_of_y(const NonlinearResult& r) {
  Result as_linear;
  as_linear.t = r.t;
  as_linear.y = r.y;
  as_linear.continuous = r.continuous;
  return bromwich::integral_of_y(as_linear);
}

// Of y, or of its integral where y may jump.
double apart_in_y(const NonlinearResult& coarse, const NonlinearResult& fine) {
  return coarse.continuous ? apart(coarse.y, fine.y) : apart(integral_of_y(coarse), integral_of_y(fine));
}

// Grids of J, 2J, 4J, ... steps until two differences, of which the second is smaller or both are a tenth of what is
// wanted, say that the error is reached.
NonlinearResult refine(const NonlinearScene& scene, const Scene& given, const std::vector<double>& breaks,
                       Backend& backend, NonlinearOptions options) {
  if (auto adapted = march_nonlinear_to_tolerance(scene, breaks, backend, options)) return std::move(*adapted);
  if (options.steps == 0) options.steps = scene.linear.steps();
  NonlinearResult coarse;
  std::optional<double> before;
  int failures = 0;
  for (;; options.steps *= 2) {
    NonlinearResult fine = NonlinearRun(scene, given, breaks, backend, options).run();
    if (fine.status == Status::interrupted || fine.status == Status::unsupported) return fine;
    const bool both = fine.status == Status::solved && coarse.status == Status::solved;
    std::optional<double> now;
    if (both) now = std::max(apart(seen(coarse), seen(fine)), apart_in_y(coarse, fine));
    if (now && before) fine.error_estimate = error_of(*before, *now, options.error);
    if (fine.error_estimate && *fine.error_estimate <= options.error) return fine;
    failures = fine.status == Status::solved ? 0 : failures + 1;
    if (failures == most_failures) {
      fine.reason += text("; %d grids in turn end before T", most_failures);
      return fine;
    }
    if (2 * options.steps > options.max_steps) {
      if (fine.status == Status::solved)
        fine.reason = fine.error_estimate
                          ? text("the error is about %.1e with %ld steps, not %.1e: more than %ld would be needed",
                                 *fine.error_estimate, long(options.steps), options.error, long(options.max_steps))
                          : "the error could not be estimated: the differences of grids do not fall";
      fine.status = Status::tolerance_not_met;
      return fine;
    }
    before = now;
    coarse = std::move(fine);
  }
}

// The limits of core/solve/certification.cpp, where half the step confirms a linear scene.
constexpr double most_mean_change = 0.1;      ///< of x and of the integral of y
constexpr double most_typical_change = 0.05;  ///< of x at 95 of 100 time points
constexpr double reported = 0.01;             ///< an error above it is

void compare_with_half_the_step(const NonlinearResult& fine, const std::string& why, NonlinearResult& result) {
  if (fine.status == Status::interrupted) {
    result.status = fine.status;
    result.reason = fine.reason;
    return;
  }
  const bool solved = fine.status == Status::solved;
  Change x, y;
  if (solved) {
    const Index J = result.t.size() - 1;
    const RowMatrix coarse = integral_of_y(result), halved = integral_of_y(fine);
    x = change_when_halved(result.x, fine.x, J);
    y = change_when_halved(coarse, halved, J);
    const double order = result.continuous ? 4.0 / 3 : 2;  // 2^p / (2^p - 1): of the coarser grid
    result.error_estimate = order * std::max(apart(result.x, fine.x), apart_in_y(result, fine));
  }
  if (!solved || !(std::max(x.mean, y.mean) <= most_mean_change) || !(x.typical <= most_typical_change) ||
      !(*result.error_estimate <= 1)) {
    result.status = Status::tolerance_not_met;
    result.reason = why + (solved ? ", and with half the step another result comes out; use more steps"
                                  : ", and with half the step it is not solved (" + fine.reason + "); use more steps");
  } else if (!(*result.error_estimate <= reported)) {
    result.warning += text("%s%s: the error is about %.0f %%; use more steps, or a tolerance",
                           result.warning.empty() ? "" : "; ", why.c_str(), 100 * *result.error_estimate);
  }
}

// Steps that are given: sources that they do not follow are named, and half the step confirms what is in doubt. What
// the engine of linear scenes has solved, it has looked at itself; large scenes are looked at as little as by it.
NonlinearResult solve_on_one_grid(const NonlinearScene& scene, const Scene& given, const std::vector<double>& breaks,
                                  Backend& backend, NonlinearOptions options) {
  NonlinearResult result = NonlinearRun(scene, given, breaks, backend, options).run();
  const bool by_linear_scene = result.newton + result.windows + result.marched == 0;
  if (!options.confirm || result.status != Status::solved || by_linear_scene) return result;
  const CoarseSources coarse = find_coarse_sources(scene.linear, result.t);
  if (coarse.missed > 0) result.warning = sentence({NoticeCode::unresolved_sources, coarse.missed, NAN, coarse.time});
  if (result.trace.size() > 0 || !scene.linear.dynamics->small_state()) return result;
  const std::string why = doubts_of(scene, result, breaks);
  if (why.empty()) return result;
  options.steps = 2 * (result.t.size() - 1);
  const NonlinearResult fine = NonlinearRun(scene, given, breaks, backend, options).run();
  compare_with_half_the_step(fine, why, result);
  return result;
}

}  // namespace

NonlinearResult solve_nonlinear(const NonlinearScene& scene, Backend& backend, const NonlinearOptions& given) {
  scene.validate();
  NonlinearOptions options = given;
  if (options.steps == 0 && options.error == 0 && options.confirm) options.error = default_tolerance(scene.linear);
  if (!(options.tolerance > 0)) throw Error("tolerance", text("found %g", options.tolerance), "give a positive number");
  if (options.steps < 0) throw Error("steps", text("found %ld", long(options.steps)), "give a positive number");
  const Index first = options.steps > 0 ? options.steps : scene.linear.steps();
  if (options.error > 0 && options.max_steps < first)
    throw Error("max_steps", text("found %ld", long(options.max_steps)),
                text("give %ld or more, the steps of the first grid", long(first)));
  if (!solves_the_discrete_problem(options.inner))
    throw Error("inner", text("%s has other steps than these", to_string(options.inner)),
                "use auto, march, contour or multigrid");
  if (!(options.error >= 0)) throw Error("error", text("found %g", options.error), "give a positive number, or 0");
  const NonlinearScene stated = in_states(scene);
  const std::vector<double> breaks = divisions_of(stated.linear);
  return options.error > 0 ? refine(stated, scene.linear, breaks, backend, options)
                           : solve_on_one_grid(stated, scene.linear, breaks, backend, options);
}

}  // namespace bromwich
