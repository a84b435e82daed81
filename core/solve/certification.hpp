#pragma once
// The checks that a result has to pass before it is called solved or infeasible: residual, kernel and ringing. Small
// dense scenes have a certificate (core/certificate). For others, where the scene magnifies errors, or its steps may
// have several solutions, half the step has to give the same result. core/accuracy/magnification.hpp measures, this
// file decides.

#include "../accuracy/magnification.hpp"
#include "methods.hpp"

namespace bromwich {

class Certification {
 public:
  Certification(Methods& methods, Backend& backend, const InnerOptions& options)
      : methods_(methods), backend_(backend), options_(options) {}

  /// Checks a result that its method calls solved; demotes it to tolerance_not_met with the reason.
  void certify(Method, Result&);

  /// Checks a result that ends at a step without a solution; demotes it if that depends on the step size.
  void confirm_infeasible(Result&);

  /// The steps are too long for this scene, or rounding leaves no digits: a method of lower order cannot do better.
  bool sensitive() const { return sensitive_; }

  /// From now on results come from a method that replaces a better one on the same grid. Modes that it damps count
  /// against them. With `confirm`, half the step has to confirm them.
  void expect_last_resort(bool confirm) {
    last_resort_ = true;
    confirm_last_resort_ = confirm;
  }

 private:
  bool judge_by_certificate(Method, Result&);
  void certify_cones(Method, Result&);
  bool sources_are_unresolved() const;  ///< their changes inside steps were given up
  double true_residual(const Result&) const;
  void confirm(Method, const Magnification&, Result&);
  void resolve_modes(Method, const RowMatrix& x, Result&);
  void doubt_growth(Method, double rate, Result&);
  void estimate_errors_at_jumps(Method, Result&);
  void look_for_other_solutions(Result&);
  Result with_half_the_step(Method, Methods& half);
  struct Slack {
    double of_y, of_x;  ///< times the allowed change
  };
  bool comes_out_the_same(Method, Index factor, Slack, const Result&);
  void confirm_one_of_several(Method, Result&);
  void confirm_by_half_the_step(Method, double slack, const std::string& why, Result&);

  bool sensitive_ = false, last_resort_ = false, confirm_last_resort_ = false;
  Methods& methods_;
  Backend& backend_;
  const InnerOptions& options_;
};

/// What is known of the errors of given steps, relative.
struct StepErrors {
  double x = 0, y = 0;
  bool of_mean = false;  ///< y: of its mean
};

/// A notice of them.
void tell_errors(const StepErrors&, Result&);
/// The same where they are known: with one above 1 nothing is solved.
void judge_errors(const StepErrors&, Result&);

/// Error estimate, notice and status by Result::certificate.
void take_certificate(Result&);

/// The largest accepted natural-map residual: rounding of the kernel, and the remaining change of an iteration.
double residual_limit(bool iterated, const Result&, const Options&);

}  // namespace bromwich
