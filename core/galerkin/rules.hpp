#pragma once
// Intervals on which the active constraints do not determine y by M: M_SS is singular (an ideal stop, an ideal diode,
// sliding). The moments of method galerkin do not damp there. From node to node an error of w is multiplied by
// P_2(1)/P_2(-1) = 1 if y acts on w', and by 3 + sqrt(8) if y acts on w''. A jump of the state leaves an error of its
// own size. Such intervals are solved by Radau IIA, with the stages c = (1/3, 1) and z = (y_1, y_2),
//
//     X_i = x_{k-1} + h Σ_j a_ij (A X_j + B y_j + f(t_{k-1} + c_j h)),   x_k = X_2,
//     0 <= y_i  ⊥  w_i = N X_i + M y_i + g(t_{k-1} + c_i h) >= 0,
//
// or by implicit Euler, one stage c = 1 and z = (y, y): if the state jumps (y is an impulse, h y does not decrease with
// h) or may jump, if y acts on w'' or a higher derivative only, and if a source jumps inside. Both have the form of
// core/galerkin/discretisation.hpp, so that solvers and checks need not distinguish them.

#include "../result/result.hpp"
#include "free.hpp"
#include "solvers.hpp"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// The scene on the intervals of `p`, all by one rule. Conditions are weighted like quadratures, 3/2 and 1/2 (Radau
/// IIA), so that D is positive semidefinite where the scene is passive.
GalerkinProblem stage_problem(const Scene&, const GalerkinProblem& p, IntervalRule);

/// One value for each rule.
template <class Value>
struct ByRule {
  Value galerkin, radau, euler;

  const Value& by(IntervalRule rule) const {
    return rule == IntervalRule::galerkin ? galerkin : rule == IntervalRule::radau ? radau : euler;
  }
};

/// The same grid by each rule.
struct RuledProblems : ByRule<GalerkinProblem> {
  RuledProblems(const Scene&, const GalerkinProblem& galerkin);
};

/// Every interval by the rule it is given. The runs are those of equal length and rule.
GalerkinProblem mixed_problem(const RuledProblems&, const std::vector<IntervalRule>&);

/// Which rule an active set needs.
class RuleChoice {
 public:
  explicit RuleChoice(const Scene&);

  /// For the values z of an interval, with free unknowns (2n) or without them: galerkin where M_SS is regular.
  IntervalRule needed(const Vector& z);
  /// Whether a breakpoint lies inside an interval.
  bool source_jumps(double begin, double end) const;

 private:
  IntervalRule decide(const std::vector<Index>& active) const;

  Index n_;
  std::vector<Index> free_rows_, bound_rows_;
  Matrix M_, NB_;
  bool free_block_is_regular_ = true;
  std::vector<double> breakpoints_;
  std::map<std::vector<Index>, IntervalRule> known_;
};

/// Whether some constraint is active at the first stage of an interval of Radau IIA and not at the second, z = (y_1,
/// y_2). This is so after a jump of the state of any size: y_1 takes w_1 to 0 and moves x_k by 3/4 : 5/12 = 9/5 of the
/// distance. It is also so for a smooth state if y ends in the interval; a step of Euler there has one error of O(h^2).
bool lets_go(const Vector& z);

/// The problems without their free unknowns.
struct ReducedProblems : ByRule<FreeElimination> {
  ReducedProblems(const RuledProblems&, const std::vector<Index>& free_rows);
};

/// Interval by interval from the initial state, each by the rule that its own solution needs; `rules` receives them.
/// z and x are those of the reduced problems.
GalerkinSolution march_by_rules(const ReducedProblems&, RuleChoice&, const Options&, std::vector<IntervalRule>& rules);

/// Rules for the next solve from a solution with these; those that are no longer needed are kept with `keep`.
std::vector<IntervalRule> next_rules(const RuledProblems&, RuleChoice&, const std::vector<IntervalRule>& rules,
                                     const RowMatrix& z, bool keep);

/// A solution of the discrete problem in which each interval is taken by the rule that it needs.
struct RuledSolution {
  GalerkinSolution reduced;  ///< of the problem without its free unknowns
  std::unique_ptr<GalerkinProblem> problem;
  std::unique_ptr<FreeElimination> elimination;  ///< of `problem`
  std::vector<IntervalRule> rules;
};

/// Solves a discrete problem without free unknowns; `full`: with them, `start`: z of known active sets.
using GalerkinSolver =
    std::function<GalerkinSolution(const GalerkinProblem& full, const GalerkinProblem&, const RowMatrix& start)>;

/// `first`: the solution or failure with all intervals by method galerkin. Empty if it needs no other rule. Initial
/// values are marched by rules; for boundary values `solver` solves again until the rules do not change.
std::optional<RuledSolution> solve_by_rules(const Scene&, const GalerkinProblem&, const FreeElimination&,
                                            const GalerkinSolution& first, const GalerkinSolver&, const Options&);

/// For Result::kernel; t: the nodes. Empty if no interval has another rule.
std::string described(const std::vector<IntervalRule>&, const Vector& t);

/// "...; 12 intervals by Radau IIA, 3 by implicit Euler", or nothing.
std::string describe(const std::vector<IntervalRule>&);

}  // namespace bromwich
