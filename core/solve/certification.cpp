#include "core/solve/certification.hpp"

#include "core/accuracy/magnification.hpp"
#include "core/accuracy/other_solution.hpp"
#include "core/base/text.hpp"
#include "core/certificate/certificate.hpp"
#include "core/kernel/resolution.hpp"
#include "core/kernel/ringing.hpp"
#include "core/result/notice.hpp"

#include <Eigen/SparseCholesky>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double most_kernel_error = 1e-6;  ///< two ways to the same weights, relative to the largest
/// Few nodes miss by a few hundredths, a contour through the spectrum by 1.
constexpr double most_literal_residual = 0.1;
constexpr double most_rounding = 1e-4;        ///< of the state, left by rounding
constexpr double most_correction = 1e-4;      ///< of y, to be consistent with its states
constexpr double doubtful_growth = 1e6;       ///< of perturbations: larger growth of the error of one step is checked
constexpr Index fewest_steps_to_judge = 32;   ///< on coarser grids every contact is short
constexpr double unresolved_impulse = 0.1;    ///< of the state, in a step in which the active set changes
constexpr double most_mean_change = 0.1;      ///< of y and x with half the step, if compared
constexpr double most_typical_change = 0.05;  ///< of x at 95 of 100 time points
constexpr double cancelled = 1e-12;           ///< a state below this part of its terms is 0
constexpr double confirmed_change = 0.05;     ///< of y before a step without a solution
constexpr double worth_a_notice = 0.02;       ///< estimated error of a component
constexpr double most_typical_error = 0.5;    ///< of the state, at one row of twenty

// The rule by which perturbations are carried from step to step. For Radau IIA that of implicit Euler or, if h is an
// eigenvalue of A^{-1}, the exponential.
Rule growth_rule(const DiscreteProblem& p, Method method, const Result& result) {
  if (by_euler(method, result)) return Rule::implicit_euler;
  if (result.continuous) return Rule::exponential;
  return !p.small_state() || has_euler_step(p.small_state()->A, p.h) ? Rule::implicit_euler : Rule::exponential;
}

// Steps over impacts and between lines of y have the flow itself.
bool has_rational_steps(Method method, const Result& result) {
  return by_euler(method, result) || (!result.continuous && !result.impacts);
}

// The rounding error of w for large terms of it: of M y in a step with an impulse, of N x where x grows along a
// constraint. `x`: of all rows, or none.
double rounding_of_w(const DiscreteProblem& p, const Result& result, const RowMatrix& x) {
  const auto* M = std::get_if<Matrix>(&p.scene.M);
  if (!M || result.y.size() == 0 || result.continuous) return 0;
  const Matrix of_x = x.rows() == result.y.rows() ? Matrix(p.small_state()->N.cwiseAbs().transpose()) : Matrix();
  double largest = 0;
  for (Index j = 0; j < result.y.rows(); ++j) {
    RowMatrix terms = result.y.row(j).cwiseAbs() * M->cwiseAbs().transpose();
    if (of_x.size() > 0) terms += x.row(j).cwiseAbs() * of_x;
    if (terms.allFinite()) largest = std::max(largest, terms.maxCoeff());
  }
  return 64 * epsilon * largest;
}

void demote(Result& result, const std::string& reason) {
  result.status = Status::tolerance_not_met;
  result.reason = reason;
}

Notice notice_of(const StepErrors& e) {
  return {.code = NoticeCode::error_of_steps, .size = e.x, .other = e.y, .of_mean = e.of_mean};
}

// Whether E is symmetric, and not positive definite.
bool has_indefinite_mass(const DiscreteProblem& p) {
  const SparseDynamics* d = p.scene.dynamics->matrices();
  if (!d || d->E.rows() == 0) return false;
  const SparseMatrix transposed = d->E.transpose();
  return (d->E - transposed).norm() <= 16 * epsilon * d->E.norm() &&
         Eigen::SimplicialLLT<SparseMatrix>(d->E).info() != Eigen::Success;
}

}  // namespace

double residual_limit(bool iterated, const Result& result, const Options& options) {
  if (!iterated) return 1e-9;
  const double accurate = std::clamp(1e3 * options.iteration_tolerance, 1e-9, 1e-2);
  return options.tuning.algebraic_share > 0 && result.algebraic_error
             ? std::clamp(1e3 * *result.algebraic_error, accurate, 0.1)
             : accurate;
}

void Certification::certify(Method method, Result& result) {
  const DiscreteProblem& p = methods_.problem();
  if (!(result.residual <= residual_limit(iterates(method), result, options_)) &&
      !(result.residual <=
        rounding_of_w(p, result, p.small_state() ? methods_.all_states(method, result) : RowMatrix())))
    return demote(result, "the residual is above the limit for a solution");
  if (method != Method::contour_literal && result.kernel_error > most_kernel_error)
    return demote(result, text("the weights of the kernel are known only to %.1e: use other steps, or method euler",
                               result.kernel_error));
  if (const double missed = method == Method::contour_literal && p.small_state() ? true_residual(result) : 0;
      !(missed <= most_literal_residual))
    return demote(result,
                  text("with the states that y gives, complementarity fails by %.1e: its contours miss them", missed));
  if (!p.scene.cones.empty()) return certify_cones(method, result);
  if (result.impacts && options_.compares_grids) return look_for_other_solutions(result);  // flows are exact
  const bool continuous = !by_euler(method, result) && result.continuous;
  // Where sources go up and down from step to step, so does y.
  const bool driven = result.defects && 4 * Index(result.defects->steps.size()) > p.J;
  if (const Index j = continuous && !driven && result.alternates.value_or(true) ? ringing_from(result.y) : -1; j >= 0)
    return demote(result,
                  text("y alternates between time points from t = %.6g on; use more steps or method euler", p.t[j]));
  const bool from_y = (continuous && !result.defects) || by_euler(method, result);
  const RowMatrix recorded = from_y ? RowMatrix() : methods_.all_states(method, result);
  const Magnification m = magnification(p, growth_rule(p, method, result), result.y, recorded);
  result.magnification = m.growth;
  result.rounding = std::isnan(m.rounding) ? 0 : m.rounding;
  result.rounding_of_y = std::isnan(m.output) ? 0 : m.output;
  if (m.rounding > most_rounding) {
    sensitive_ = true;
    return demote(result, text("rounding alone changes the state by %.1e of its size up to T: the result has no digits",
                               std::min(m.rounding, 1.0)));
  }
  if (m.correction > most_correction)
    return demote(result, text("y and the states that it leads to part by %.1e of y, because the free state grows: %s",
                               m.correction, method == Method::march ? "use more steps" : "use method march"));
  const bool rational = has_rational_steps(method, result);
  if (options_.compares_grids) {  // the next grid is half the step
    resolve_modes(method, m.x, result);
    if (rational && result.status == Status::solved) doubt_growth(method, growth_rate(p), result);
    if (result.status == Status::solved) look_for_other_solutions(result);
    return;
  }
  if (options_.confirm && judge_by_certificate(method, result)) {
    if (result.status == Status::solved) look_for_other_solutions(result);
    return;
  }
  confirm(method, m, result);
  if (options_.confirm && result.status == Status::solved) resolve_modes(method, m.x, result);
  if (rational && result.status == Status::solved) doubt_growth(method, growth_rate(p), result);
  if (result.status == Status::solved && !sources_are_unresolved()) estimate_errors_at_jumps(method, result);
  if (result.status == Status::solved) look_for_other_solutions(result);
}

// The state over exact flows has no error but that of the forces of steps. What is unique is not known with friction of
// normal forces.
void Certification::certify_cones(Method method, Result& result) {
  if (result.well_posed || options_.compares_grids) return;
  confirm_one_of_several(method, result);
  if (result.status == Status::solved) tell(result, {.code = NoticeCode::may_be_others});
}

bool Certification::sources_are_unresolved() const {
  const auto& sources = methods_.problem().sources;
  return sources && sources->unresolved > 0;
}

// Small dense scenes: the error of each part of the result, from y alone.
bool Certification::judge_by_certificate(Method method, Result& result) {
  const DiscreteProblem& p = methods_.problem();
  if (!Methods::has_small_dense_state(p.scene) || sources_are_unresolved()) return false;
  std::vector<double> breakpoints = p.scene.breakpoints;
  for (const RoughStep& rough : p.sources ? p.sources->rough : std::vector<RoughStep>()) {
    breakpoints.insert(breakpoints.end(), rough.ends.begin(), rough.ends.end());
    for (const SourcePiece& piece : rough.pieces) breakpoints.push_back(piece.start);
  }
  std::sort(breakpoints.begin(), breakpoints.end());
  result.certificate = bromwich::certify(p.scene, result, breakpoints, methods_.all_states(method, result));
  if (!result.certificate) return false;
  take_certificate(result);
  sensitive_ = result.status != Status::solved;
  return true;
}

void take_certificate(Result& result) {
  Certificate& c = *result.certificate;
  c.impulses = c.impulses || result.starts_with_impulse || result.euler_steps > 0;
  const double of_y = c.impulses ? c.error_of_mean : c.error_of_y;
  result.error_estimate = std::max(of_y, c.error_of_x);
  if (result.error_estimate <= worth_a_notice) return;
  const StepErrors errors{c.error_of_x, of_y, c.impulses};
  if (std::min(c.typical_error_of_x, c.error_of_x) <= most_typical_error) return judge_errors(errors, result);
  demote(result, sentence(notice_of(errors)));
}

void tell_errors(const StepErrors& errors, Result& result) { tell(result, notice_of(errors)); }

void judge_errors(const StepErrors& errors, Result& result) {
  if (std::max(errors.x, errors.y) > 1) return demote(result, sentence(notice_of(errors)));
  tell_errors(errors, result);
}

// Where something speaks against a result that half the step would show, half the step is taken.
void Certification::confirm(Method method, const Magnification& m, Result& result) {
  const DiscreteProblem& p = methods_.problem();
  const bool continuous = !by_euler(method, result) && result.continuous;
  if (!result.well_posed)
    confirm_one_of_several(method, result);
  else if (m.growth > doubtful_growth)
    confirm_by_half_the_step(method, 1, text("errors of a step grow up to %.1e times with these steps", m.growth),
                             result);
  else if (Methods::has_small_dense_state(p.scene) && !sources_are_unresolved())
    confirm_by_half_the_step(method, 1, "no solution with located switches was found to compare with", result);
  // With M of class P a contact is a spring, however stiff, and its rebound wants to be resolved. (With M = 0 an
  // impact is over at once, and nothing is to be resolved.)
  else if (m.impulse > unresolved_impulse && has_one_solution(p.lcp_class) && p.J >= fewest_steps_to_judge)
    confirm_by_half_the_step(method, continuous ? 5 : 1, "a constraint is active for a few steps only, and strongly",
                             result);
  else if (confirm_last_resort_)
    confirm_by_half_the_step(method, 1, "implicit Euler stands in for a method that was refused", result);
}

// y may be one of several that all lead to the same state: then the state alone has to come out the same.
void Certification::confirm_one_of_several(Method method, Result& result) {
  if (comes_out_the_same(method, 2, {1, 1}, result)) return;
  demote(result,
         "the problems of the steps may have several solutions, and with half the step another result comes "
         "out; use more steps or another method");
}

// Modes of the state between switches that the rule damps on this grid and on the next one alike.
void Certification::resolve_modes(Method method, const RowMatrix& known, Result& result) {
  const DiscreteProblem& p = methods_.problem();
  if (!has_rational_steps(method, result) || !Methods::has_small_dense_state(p.scene)) return;
  // Implicit Euler takes the means of rough sources, and has other states then.
  const bool fits = known.rows() == p.J + 1 && !(by_euler(method, result) && p.sources);
  const RowMatrix made = fits ? RowMatrix() : methods_.all_states(method, result);
  const RowMatrix& x = fits ? known : made;
  if (x.rows() != p.J + 1) return;
  const auto damping = by_euler(method, result) ? euler_damping : radau_damping;
  const char* rule = by_euler(method, result) ? "implicit Euler" : "Radau IIA";
  std::string what;
  if (const auto growing = damped_growth(p, result.y, x, damping))
    what = text("the scene has a mode that grows like e^(%.3g t)", growing->real());
  else if (const auto fast = unresolved_oscillation(p, result.y, x, damping))
    what = text("the state oscillates with %.3g radians per unit of time", std::abs(fast->imag()));
  if (what.empty()) return;
  sensitive_ = true;
  demote(result, what + text(", which %s damps at this step; use more steps", rule));
}

// Rules that are stable for all modes that decay damp fast ones that grow, too.
void Certification::doubt_growth(Method method, double rate, Result& result) {
  constexpr double followed = 0.25;  // h times the rate
  const DiscreteProblem& p = methods_.problem();
  const std::string why = text("the scene has a mode that grows like e^(%.3g t)", rate) +
                          (has_indefinite_mass(p) ? " (E is not positive definite)" : "");
  if (p.h * rate > followed) {
    sensitive_ = true;
    demote(result, why + text(", and steps of %.3g do not resolve it: give a tolerance, or about %.0f steps", p.h,
                              std::ceil(p.scene.T * rate / followed)));
  } else if (!options_.compares_grids && p.scene.T * rate > std::log(doubtful_growth)) {
    confirm_by_half_the_step(method, 1, why, result);
  }
}

// A solution that is not the only one is said to be one of several, where another one is seen.
void Certification::look_for_other_solutions(Result& result) {
  const DiscreteProblem& p = methods_.problem();
  const bool suspect = !result.well_posed || selects_least(p.lcp_class) || !selects_one(p.lcp_class);
  if (!suspect) return;
  const OtherSolution other = Methods::has_small_dense_state(p.scene)
                                  ? other_solution(p, result, methods_.all_states(result.method, result))
                                  : OtherSolution{};
  if (other.row < 0 && (result.well_posed || other.searched)) return;
  const NoticeCode code = other.row < 0           ? NoticeCode::may_be_others
                          : other.row == 0        ? NoticeCode::other_start
                          : other.moves_the_state ? NoticeCode::other_state
                                                  : NoticeCode::other_y;
  tell(result, {.code = code, .t = p.t[std::max<Index>(other.row, 0)]});
}

// The natural map with N x of the states that y gives by the matrix exponential: contours of the method itself do not
// enter.
double Certification::true_residual(const Result& result) const {
  const DiscreteProblem& p = methods_.problem();
  const RowMatrix x = states_from(p, Rule::exponential, result.y);
  const RowMatrix q = x * p.small_state()->N.transpose() + p.g.table();
  const RowMatrix w = q + result.y * to_dense(p.scene.M).transpose();
  // Each row against its own terms.
  const Matrix M = to_dense(p.scene.M).cwiseAbs();
  const RowMatrix terms = q.cwiseAbs() + result.y * M.transpose();
  double worst = 0;
  for (Index i = 0; i < w.cols(); ++i) {
    const double of_w = std::max(terms.col(i).maxCoeff(), 1e-290), of_y = std::max(result.y.col(i).maxCoeff(), 1e-290);
    for (Index k = 0; k <= p.J; ++k) {
      const double y = result.y(k, i) / of_y, open = w(k, i) / of_w;
      if (std::isnan(open)) return NAN;
      worst = std::max(worst, std::max(-open, std::min(y, open)));
    }
  }
  return worst;
}

Result Certification::with_half_the_step(Method method, Methods& half) {
  const DiscreteProblem &p = methods_.problem(), &finer = half.problem();
  note(options_.log, LogLevel::info, "solved again with %ld steps instead of %ld, to confirm the result", long(finer.J),
       long(p.J));
  Result fine;
  half.run(method, options_, fine);
  return fine;
}

// Whether J times `factor` steps give the same result, up to what a step of this size may miss. y is compared by its
// integral, so that impulses are. Not looked into where no confirmation is wanted.
bool Certification::comes_out_the_same(Method method, Index factor, Slack slack, const Result& result) {
  if (!options_.confirm) return true;
  const DiscreteProblem& p = methods_.problem();
  Methods finer(p.scene, backend_, factor * p.J, {}, p.sources != nullptr, methods_.family());
  const Result fine = with_half_the_step(method, finer);
  if (fine.status != Status::solved) return false;
  const auto rows = Eigen::seq(0, factor * p.J, factor / 2);  // those that half the step has
  const Change y = change_when_halved(integral_of_y(result), integral_of_y(fine)(rows, Eigen::all), p.J);
  if (!(y.mean <= slack.of_y * most_mean_change)) return false;
  if (!Methods::has_small_dense_state(p.scene)) return true;
  const RowMatrix coarse = methods_.all_states(method, result),
                  halved = finer.all_states(method, fine)(rows, Eigen::all);
  // A state held at 0 by terms that cancel is rounding. x0 may be another one.
  const double terms = p.scene.T * (result.y * p.small_state()->B.transpose()).cwiseAbs().maxCoeff();
  const auto largest = [](const RowMatrix& x) { return x.bottomRows(x.rows() - 1).cwiseAbs().maxCoeff(); };
  if (std::max(largest(coarse), largest(halved)) <= cancelled * terms) return true;
  const Change x = change_when_halved(coarse, halved, p.J);
  return x.mean <= slack.of_x * most_mean_change && x.typical <= slack.of_x * most_typical_change;
}

// A step may have several solutions, or see a contact hardly at all: with half the step the same must come out. What
// these steps do not resolve no method of lower order will.
void Certification::confirm_by_half_the_step(Method method, double slack, const std::string& why, Result& result) {
  if (comes_out_the_same(method, 2, {slack, slack}, result)) return;
  sensitive_ = true;
  demote(result, why + ", and with half the step another result comes out; use more steps or another method");
}

// A step without a solution ends the discrete problem. It says something about the scene only where the solution up
// to there is one: with half the step the end has to stay where it is, and so has y.
void Certification::confirm_infeasible(Result& result) {
  if (!options_.confirm) return;
  const DiscreteProblem& p = methods_.problem();
  const Method method = result.method;
  Methods half(p.scene, backend_, 2 * p.J, {}, p.sources != nullptr, methods_.family());
  const Result fine = with_half_the_step(iterates(method) ? Method::march : method, half);
  const double at = *result.infeasible_at;
  const Index last = std::max<Index>(Index(std::llround(at / p.h)) - 1, 0);
  const bool same_end = fine.status == Status::infeasible && std::abs(*fine.infeasible_at - at) <= 2 * p.h;
  if (same_end && (last == 0 || change_when_halved(result.y, fine.y, last).largest <= confirmed_change)) return;
  result.infeasible_at.reset();
  demote(result,
         text("the step to t = %.6g has no solution, but that changes with the step: not proven for the scene", at));
}

}  // namespace bromwich
