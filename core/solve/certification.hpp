#pragma once
// What a result has to pass before it is called solved, or infeasible: residual, kernel, ringing, and, where the scene
// magnifies errors or its steps may have several solutions, the same with half the step
// (core/accuracy/magnification.hpp measures, this decides).

#include "../accuracy/magnification.hpp"
#include "methods.hpp"

namespace bromwich {

class Certification {
 public:
  Certification(Methods& methods, Backend& backend, const InnerOptions& options)
      : methods_(methods), backend_(backend), options_(options) {}

  /// Of a result that its method calls solved; demotes it to tolerance_not_met with the reason.
  void certify(Method, Result&);

  /// Of a result that a step without a solution has ended; demotes it where that depends on the step.
  void confirm_infeasible(Result&);

  /// The steps are too long for this scene, or rounding leaves nothing: no method of lower order will do better.
  bool sensitive() const { return sensitive_; }

  /// From now on results come from a method that stands in for a better one on the same grid. Modes that it damps count
  /// against them. Half the step has to confirm them, unless the steps of the better method were in doubt, not its
  /// order.
  void expect_last_resort(bool confirm) {
    last_resort_ = true;
    confirm_last_resort_ = confirm;
  }

 private:
  bool states_are_known(const Result&) const;
  double true_residual(const Result&) const;
  void confirm(Method, const Magnification&, Result&);
  void resolve_modes(Method, const RowMatrix& x, Result&);
  void look_for_other_solutions(Result&);
  Result with_half_the_step(Method, Methods& half);
  struct Slack {
    double of_y, of_x;  ///< times what may change
  };
  bool comes_out_the_same(Method, Index factor, Slack, const Result&);
  void confirm_one_of_several(Method, Result&);
  void confirm_by_fine_steps(Method, double rate, const std::string& why, Result&);
  void confirm_errors_stay_small(Method, const Magnification&, Result&);
  void confirm_by_half_the_step(Method, double slack, const std::string& why, Result&);

  bool sensitive_ = false, last_resort_ = false, confirm_last_resort_ = false;
  Methods& methods_;
  Backend& backend_;
  const InnerOptions& options_;
};

/// The largest natural-map residual of a solution: rounding of the kernel, and what an iteration tolerance leaves open.
double residual_limit(bool iterated, const Result&, const Options&);

}  // namespace bromwich
