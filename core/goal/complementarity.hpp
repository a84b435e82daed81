#pragma once
// Goal-oriented time grids for port-Hamiltonian scenes with complementarity: the cycle of core/goal/goal.hpp with the
// steps and the adjoint of core/goal/constrained_path.hpp. The quantity is a function of x only, with y(t) in SOL(M,
// N x(t) + g(t)); the power of the constraints is supplied power. The residual on the halved grid is that of the
// nonlinear step, which includes a constraint that becomes active within a cell.

#include "constrained_path.hpp"
#include "grid_adaptation.hpp"

namespace bromwich {

class ConstrainedGoal {
 public:
  /// The arguments have to outlive it. Throws Error for the exponential scheme, and as ConstrainedSystem.
  ConstrainedGoal(const Scene&, Backend&, const GoalOptions&);

  /// The quantity is NaN if a step could not be solved.
  GoalEvaluation evaluate(const Vector& t);

  /// On the last evaluated grid.
  EnergyBalance balance(const AdaptedGrid&) const;
  PowerBalance power(const AdaptedGrid&, const Result&) const;
  /// Sets y at the time points, residual and counters; status and reason if a step could not be solved.
  void report(const AdaptedGrid&, Result&);

  ConstrainedSystem& system() { return system_; }

 private:
  ConstrainedSystem system_;
  Backend& backend_;
  const GoalOptions& goal_;
  std::shared_ptr<const QuantityOfInterest> quantity_;
  ConstrainedSolution last_;
  ConstraintPath path_;  ///< of it
  long solved_ = 0;
};

}  // namespace bromwich
