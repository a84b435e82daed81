#include "tests/support/verdict.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace bromwich::oracle {
namespace {

/// A residual of 1e-9 counts as solved. x is recorded by a second pass over the steps; rounding of the two passes may
/// differ where the scene magnifies it.
constexpr double most_violation = 1e-8;
/// x_j against free + drive y: rounding of an exponential of a stiff or non-normal hA.
constexpr double most_in_state = 1e-9;
/// Fraction of the largest state so far that counts as a term of every sum: 1e-8 of it is 1e-13, rounding with a
/// margin.
constexpr double carried = 1e-5;
/// Solutions that differ by more count as different.
constexpr double same_solution = 1e-6;
/// Each part of a step behind an impulse is longer than the one before by this share, and so is the error of implicit
/// Euler there, at most.
constexpr double growth_of_parts = 0.02;
/// A step behind an impulse may miss a layer that it resolves by parts twice as long as their distance, 3 %, beside the
/// error of implicit Euler.
constexpr double most_behind_impulse = 0.05;

double largest(const Vector& v) { return v.size() == 0 ? 0 : v.cwiseAbs().maxCoeff(); }

/// Complementarity of y and w, row by row, relative to the terms of w. `columns`: contribution of a unit of y_i to the
/// rows, in those terms. A y_i below rounding counts as zero.
double violation(const Vector& y, const Vector& w, const Vector& terms, const Vector& columns) {
  double worst = 0;
  for (Index i = 0; i < y.size(); ++i) {
    if (y[i] < 0) return INFINITY;
    const double negative = std::max(-w[i], 0.0) / terms[i], open = std::max(w[i], 0.0) / terms[i];
    if (terms[i] > 0) worst = std::max({worst, negative, std::min(open, y[i] * columns[i])});
  }
  return worst;
}

/// The state at h from an x0 that violates the constraints: implicit Euler in parts that grow from 1e-9 h on. Empty if
/// a part has no solution.
std::optional<Vector> behind_impulse(const DenseScene& s, double h) {
  Vector x = s.x0, y = Vector::Zero(s.M.rows());
  for (double from = 0, to = 1e-9 * h; from < h; from = to, to = std::min(h, (1 + growth_of_parts) * to)) {
    DenseScene part = s;
    part.T = to - from;
    part.f = [&s, from](double t, Eigen::Ref<Vector> out) { out = value(s.f, from + t, s.A.rows()); };
    part.g = [&s, from](double t, Eigen::Ref<Vector> out) { out = value(s.g, from + t, s.M.rows()); };
    const StepProblem p = Steps(part, Scheme::euler, 1).problem(1, x, y);
    const auto found = step_solution(part, p, y);
    if (!found) return std::nullopt;
    y = *found;
    x = p.free + p.drive * y;
  }
  return x;
}

class Judge {
 public:
  Judge(const DenseScene& s, const Result& r)
      : s_(s),
        r_(r),
        scheme_(scheme_of(r)),
        J_(r.steps),
        h_(s.T / double(J_)),
        main_(s, scheme_, J_),
        euler_(s, Scheme::euler, J_) {}

  Verdict verdict() {
    r_.status == Status::solved ? solved() : infeasible();
    return verdict_;
  }

  bool missed() {
    if (r_.y.rows() != J_ + 1 || r_.x.rows() != J_ + 1) return false;
    Index end = 0;
    while (end <= J_ && r_.y.row(end).allFinite()) ++end;
    if (end > J_) return true;
    if (end == 0) {
      impulse_ = r_.starts_with_impulse;
      return impulse_ ? has_solution(1) : !solutions(s_.M, q(0)).empty();
    }
    return has_solution(end);
  }

 private:
  bool solved() {
    if (!r_.y.allFinite() || !r_.x.allFinite()) return fails("y or x is not finite");
    if (!start()) return false;
    for (Index j = 1; j <= J_; ++j)
      if (!step(j)) return false;
    // If y_1 is not unique, or the state is only rounding, an Euler step may be a Radau IIA step too.
    if (scheme_ == Scheme::radau &&
        (unique_ && !vanished_ && !impulse_ ? long(r_.euler_steps) != jumps_ : long(r_.euler_steps) < jumps_))
      return fails(text("%ld steps by Euler were found, %ld are reported", long(jumps_), long(r_.euler_steps)));
    return compare_residual();
  }

  bool infeasible() {
    if (!r_.infeasible_at) return fails("infeasible without a time");
    if (s_.lcp_class == LcpClass::P) return fails("infeasible, but M is P: y is a Lipschitz function of the state");
    const Index end = Index(std::llround(*r_.infeasible_at / h_));
    if (end == 0) return solutions(s_.M, q(0)).empty() || fails("infeasible at t = 0, but there is a solution");
    if (!start()) return false;
    for (Index j = 1; j < end; ++j)
      if (!step(j)) return false;
    if (has_solution(end)) return fails(text("infeasible at step %ld, but it has a solution", long(end)));
    // Steps with several solutions: if one branch ends, another may continue.
    if (!unique_ && trajectory(s_, scheme_, J_).infeasible < 0)
      return fails(text("infeasible at step %ld, but other solutions of earlier steps lead to T", long(end)));
    return true;
  }

  /// The step to t_j from the x_{j-1} and y_{j-1} of the result, by Radau IIA or else by Euler.
  bool has_solution(Index j) const {
    const Vector before = j > 1 ? x(j - 1) : s_.x0, last = impulse_ && j == 1 ? Vector::Zero(s_.M.rows()) : y(j - 1);
    const StepProblem p = main_.problem(j, before, last);
    if (step_solution(s_, p, last.replicate(p.q.size() / s_.M.rows(), 1))) return true;
    return scheme_ == Scheme::radau && step_solution(s_, euler_.problem(j, before, last), last);
  }

  Vector x(Index j) const { return r_.x.row(j).transpose(); }
  Vector y(Index j) const { return r_.y.row(j).transpose(); }
  Vector g(Index j) const { return value(s_.g, h_ * double(j), s_.M.rows()); }
  Vector q(Index j) const { return s_.N * (j == 0 ? s_.x0 : x(j)) + g(j); }

  bool fails(const std::string& what) {
    verdict_.failure = what;
    return false;
  }

  bool accepts(Index j, double relative, const Vector& w) {
    verdict_.violation = std::max(verdict_.violation, relative);
    if (relative <= most_violation) return true;
    // An iteration guarantees 1e-9 in the natural map only, absolute if below 1.
    if (iterates(r_.method) && largest(y(j).cwiseMin(w)) <= 1.1e-9 * std::max(1.0, largest(w - s_.M * y(j))))
      return true;
    return fails(text("row %ld is not complementary: violation %.1e of its terms", long(j), relative));
  }

  bool start() {
    const Vector q0 = q(0), w = s_.M * y(0) + q0;
    const Vector terms = s_.M.cwiseAbs() * y(0) + s_.N.cwiseAbs() * s_.x0.cwiseAbs() + g(0).cwiseAbs();
    if (r_.starts_with_impulse) {
      impulse_ = true;
      return !selected_solution(s_.M, q0, s_.lcp_class) || fails("an impulse at t = 0, but there is a solution");
    }
    if (!accepts(0, violation(y(0), w, terms, columns(s_.M, terms)), w)) return false;
    if (s_.lcp_class != LcpClass::Z && s_.lcp_class != LcpClass::PSD) return true;
    const auto selected = selected_solution(s_.M, q0, s_.lcp_class);
    if (!selected || differs(*selected, y(0))) return fails("y_0 is not the solution that the class selects");
    return true;
  }

  static bool differs(const Vector& a, const Vector& b) { return largest(a - b) > same_solution * largest(b); }

  static Vector columns(const Matrix& M, const Vector& terms) {
    const Vector inverse = (terms.array() > 0).select(terms.cwiseInverse(), Vector::Zero(terms.size()));
    return (inverse.asDiagonal() * M.cwiseAbs()).colwise().maxCoeff().transpose();
  }

  /// Size of the terms of x_j. Rounding of an earlier large state remains after the state has become small.
  double state_size(const StepProblem& p, Index j, const Vector& Y) const {
    return largest(x(j - 1)) + largest(p.free) + largest(p.drive.cwiseAbs() * Y) + largest(x(j)) + carried * before_;
  }

  /// Sizes of the terms of N X + g for each stage.
  Vector terms_of(const StepProblem& p, Index j, const Vector& Y) const {
    Vector terms = p.matrix.cwiseAbs() * Y + p.q.cwiseAbs();
    const Vector seen = s_.N.cwiseAbs().rowwise().sum() * state_size(p, j, Y) + g(j).cwiseAbs();
    for (Index i = 0; i < terms.size(); ++i) terms[i] += seen[i % seen.size()];
    return terms;
  }

  double state_error(const StepProblem& p, Index j, const Vector& Y) const {
    const double size = state_size(p, j, Y);
    return size > 0 ? largest(p.free + p.drive * Y - x(j)) / size : 0;
  }

  bool one_stage(const StepProblem& p, Index j) {
    if (const double e = state_error(p, j, y(j)); !(e <= most_in_state))
      return fails(text("x_%ld does not follow from x and y: %.1e", long(j), e));
    const Vector w = s_.M * y(j) + q(j), terms = terms_of(p, j, y(j));
    if (!accepts(j, violation(y(j), w, terms, columns(p.matrix, terms)), w)) return false;
    // The tolerance of an iteration may exceed the limit of this comparison.
    if (s_.lcp_class != LcpClass::Z || (iterates(r_.method) && is_p_matrix(s_.M))) return true;
    const auto least = selected_solution(s_.M, q(j), LcpClass::Z);
    if (least && differs(*least, y(j)) && (*least - y(j)).minCoeff() < -same_solution * largest(y(j)))
      return fails(text("row %ld is a solution, but not the least", long(j)));
    return true;
  }

  /// Y = (y_1, y_2) with x_j and y_2 of the result; y_1 on the active set T from the state and its own rows.
  double try_first_stage(const StepProblem& p, Index j, const std::vector<Index>& T, Vector& Y) const {
    const Index n = s_.M.rows(), m = s_.A.rows(), k = Index(T.size());
    Y << Vector::Zero(n), y(j);
    const Vector rest = p.matrix * Y + p.q, state = x(j) - p.free - p.drive * Y;
    const Vector terms = terms_of(p, j, Y);
    const double size = state_size(p, j, Y);
    if (k > 0) {
      Matrix rows(m + k, k);
      Vector right(m + k);
      rows.topRows(m) = p.drive(Eigen::all, T) / std::max(size, 1e-300);
      right.head(m) = state / std::max(size, 1e-300);
      const Vector weights = terms(T).cwiseMax(1e-300).cwiseInverse();
      rows.bottomRows(k) = weights.asDiagonal() * p.matrix(T, T);
      right.tail(k) = -weights.cwiseProduct(rest(T));
      const Vector norms = rows.colwise().norm().transpose().cwiseMax(1e-300);
      rows = (rows * norms.cwiseInverse().asDiagonal()).eval();
      Y(T) = norms.cwiseInverse().cwiseProduct(Vector(rows.colPivHouseholderQr().solve(right))).cwiseMax(0);
    }
    if (!(state_error(p, j, Y) <= most_in_state)) return INFINITY;
    const Vector all = terms_of(p, j, Y);
    return violation(Y, p.matrix * Y + p.q, all, columns(p.matrix, all));
  }

  bool step(Index j) {
    if (j == 1) regular_ = impulse_ ? Vector(Vector::Zero(s_.M.rows())) : y(0);
    before_ = std::max(before_, largest(x(j - 1)));
    vanished_ = vanished_ || largest(x(j - 1)) <= carried * before_;
    const StepProblem p = main_.problem(j, x(j - 1), y(j - 1));
    if (j == 1) unique_ = is_p_matrix(p.matrix);
    if (impulse_ && j == 1 && scheme_ == Scheme::radau) return first_step();
    if (scheme_ != Scheme::radau) {
      if (impulse_ && j == 1 && differs(y(0), y(1))) return fails("y_0 of an impulse is not y_1");
      return one_stage(p, j);
    }
    const Index n = s_.M.rows();
    Vector Y(2 * n), best_Y(2 * n);
    double best = INFINITY;
    for (unsigned flips = 0, set; flips < 1u << n && best > most_violation; ++flips) {
      set = last_ ^ flips;
      std::vector<Index> T;
      for (Index i = 0; i < n; ++i)
        if (set >> i & 1u) T.push_back(i);
      const double found = try_first_stage(p, j, T, Y);
      if (found >= best) continue;
      best = found;
      best_Y = Y;
      if (best <= most_violation) last_ = set;
    }
    if (best <= most_violation) {
      verdict_.violation = std::max(verdict_.violation, best);
      // If Y is not unique, the result may belong to another one.
      if (really_jumps(p, j, best_Y) && unique_ && step_solution(s_, euler_step(j), y(j)))
        return fails(text("step %ld jumps, but was not taken by Euler", long(j)));
      regular_ = regular_.cwiseMax(y(j));
      return true;
    }
    return jump_step(p, j, best);
  }

  /// Not only by the remaining rounding of an earlier, larger state.
  bool really_jumps(const StepProblem& p, Index j, const Vector& Y) const {
    return jumps(s_, h_, Y, x(j - 1), x(j), regular_, 1.001) && largest(p.drive * Y) > carried * before_;
  }

  /// From a state that violates the constraints: a step in parts, the first of which holds the impulse.
  bool first_step() {
    const Vector w = s_.M * y(1) + q(1);
    const Vector terms = s_.M.cwiseAbs() * y(1) + s_.N.cwiseAbs() * x(1).cwiseAbs() + g(1).cwiseAbs();
    regular_ = y(1);
    if (!accepts(1, violation(y(1), w, terms, columns(s_.M, terms)), w)) return false;
    const auto found = unique_ ? behind_impulse(s_, h_) : std::nullopt;
    const double size = std::max(largest(x(0)), largest(x(1)));
    if (found && largest(*found - x(1)) > most_behind_impulse * size)
      return fails(text("the state behind the impulse is off by %.1e of its size", largest(*found - x(1)) / size));
    return true;
  }

  StepProblem euler_step(Index j) const { return euler_.problem(j, x(j - 1), y(j - 1)); }

  bool jump_step(const StepProblem& p, Index j, double as_radau) {
    const StepProblem jump = euler_step(j);
    const Vector terms = terms_of(jump, j, y(j)), w = jump.matrix * y(j) + jump.q;
    const double as_euler = violation(y(j), w, terms, columns(jump.matrix, terms));
    if (!(as_euler <= most_violation) || !(state_error(jump, j, y(j)) <= most_in_state))
      return fails(text("step %ld is no step of Radau IIA (%.1e) nor of Euler (%.1e, state %.1e)", long(j), as_radau,
                        as_euler, state_error(jump, j, y(j))));
    ++jumps_;
    verdict_.violation = std::max(verdict_.violation, as_euler);
    const auto stages = step_solution(s_, p, y(j).replicate(2, 1));
    if (stages && unique_ && !jumps(s_, h_, *stages, x(j - 1), p.free + p.drive * *stages, regular_, 0.999) &&
        largest(x(j - 1)) > carried * before_)
      return fails(text("step %ld was taken by Euler without a jump", long(j)));
    return true;
  }

  bool compare_residual() {
    double magnitude = 1;
    for (Index j = impulse_ ? 1 : 0; j <= J_; ++j) {
      const Vector qj = q(j), w = s_.M * y(j) + qj;
      const double scale = std::max(1.0, largest(qj));
      verdict_.residual = std::max(verdict_.residual, largest(y(j).cwiseMin(w)) / scale);
      const double terms = largest(s_.M.cwiseAbs() * y(j) + s_.N.cwiseAbs() * x(j).cwiseAbs() + g(j).cwiseAbs());
      magnitude = std::max(magnitude, terms / scale);
    }
    // Both are rounding errors of their terms, magnified like the violation.
    const double limit = (1e-10 + 10 * verdict_.violation) * magnitude;
    if (!(std::abs(verdict_.residual - r_.residual) <= limit))
      return fails(text("the residual is %.1e, not %.1e", verdict_.residual, r_.residual));
    return true;
  }

  const DenseScene& s_;
  const Result& r_;
  Scheme scheme_;
  Index J_;
  double h_;
  Steps main_, euler_;
  bool impulse_ = false;
  bool unique_ = false;    ///< the matrix of a step is P
  bool vanished_ = false;  ///< the state has been only rounding
  double before_ = 0;      ///< largest state so far
  unsigned last_ = 0;      ///< active set of the first stage in the last step
  long jumps_ = 0;
  Vector regular_;  ///< largest y_i at the ends of steps without jumps so far
  Verdict verdict_;
};

}  // namespace

Scheme scheme_of(const Result& result) {
  if (by_euler(result) || result.kernel.starts_with("implicit Euler on the state")) return Scheme::euler;
  return result.kernel.starts_with("y discontinuous") ? Scheme::radau : Scheme::exponential;
}

Verdict judge(const DenseScene& scene, const Result& result) { return Judge(scene, result).verdict(); }

Trial try_method(const RandomScene& random, const DenseScene& dense, Method method, Backend& backend) {
  Options options;
  options.method = method;
  options.steps = random.steps;
  options.states = StateSelection::all;
  Trial trial;
  try {
    const Result result = solve(random.scene, backend, options);
    trial.status = bromwich::to_string(result.status);
    trial.reason = result.reason;
    trial.kernel = result.kernel;
    // Steps with unresolved sources are not those of the discretisation (tests/scene/test_sources.cpp).
    if (result.rough_steps > 0) return trial;
    if (result.status == Status::solved || result.status == Status::infeasible) {
      const Verdict verdict = judge(dense, result);
      trial.failure = verdict.failure;
      trial.violation = verdict.violation;
    } else if (result.status == Status::tolerance_not_met && !iterates(result.method)) {
      trial.missed = Judge(dense, result).missed();
    } else if (result.reason.empty()) {
      trial.failure = "no reason is given";
    }
  } catch (const Error& error) {
    trial.status = "refused";
    trial.reason = error.what();
  }
  return trial;
}

}  // namespace bromwich::oracle
