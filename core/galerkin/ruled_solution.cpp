#include "core/base/text.hpp"
#include "core/galerkin/rules.hpp"
#include "core/lcp/lcp_class.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr int most_passes = 12, free_passes = 6;
constexpr double most_bytes = 2e9;  ///< of the matrices of all runs

bool ended_early(const GalerkinSolution& s) {
  return s.status == Status::tolerance_not_met || s.status == Status::infeasible || s.status == Status::nonfinite;
}

bool any_rule_needed(RuleChoice& choice, const RowMatrix& z) {
  for (Index k = 0; k < z.rows(); ++k)
    if (choice.needed(z.row(k).transpose()) != IntervalRule::galerkin) return true;
  return false;
}

void set_problem(const Scene& scene, GalerkinProblem p, RuledSolution& ruled) {
  ruled.problem = std::make_unique<GalerkinProblem>(std::move(p));
  ruled.elimination = std::make_unique<FreeElimination>(*ruled.problem, scene.free_rows);
}

// Solves with given rules, from the active sets of z (of the scene).
void solve_again(const Scene& scene, const RuledProblems& problems, const GalerkinSolver& solver, const RowMatrix& z,
                 RuledSolution& ruled) {
  set_problem(scene, mixed_problem(problems, ruled.rules), ruled);
  LcpCount before = ruled.reduced.lcp;
  before.unsolved = 0;
  ruled.reduced = solver(*ruled.problem, ruled.elimination->reduced(), ruled.elimination->bound_part(z));
  ruled.reduced.lcp += before;
}

// Solves with all intervals by Radau IIA or, where that fails, by implicit Euler.
bool solve_by_one_rule(const Scene& scene, const RuledProblems& problems, const GalerkinSolver& solver,
                       RuledSolution& ruled) {
  const GalerkinProblem& p = problems.galerkin;
  for (const IntervalRule all : {IntervalRule::radau, IntervalRule::euler}) {
    ruled.rules.assign(std::size_t(p.N), all);
    solve_again(scene, problems, solver, RowMatrix::Zero(p.N, p.unknowns()), ruled);
    if (ruled.reduced.status == Status::solved) return true;
  }
  return false;
}

double bytes_of(const GalerkinProblem& p, const std::vector<IntervalRule>& rules) {
  double runs = double(p.runs.size());
  for (std::size_t k = 1; k < rules.size(); ++k) runs += rules[k] != rules[k - 1];
  const double m = double(p.states()), n = double(p.unknowns());
  return 3 * sizeof(double) * runs * (m * m + 2 * m * n + 2 * n * n);  // the problem, the reduced one, maps
}

void give_up(RuledSolution& ruled, const std::string& why) {
  ruled.reduced.status = Status::tolerance_not_met;
  ruled.reduced.reason = why;
}

// Boundary values: the rules follow from a solution, and the next solution from the rules.
void settle(const Scene& scene, const RuledProblems& problems, const GalerkinSolver& solver, RuleChoice& choice,
            RowMatrix z, RuledSolution& ruled) {
  for (int pass = 0; pass < most_passes; ++pass) {
    std::vector<IntervalRule> next = next_rules(problems, choice, ruled.rules, z, pass >= free_passes);
    if (next == ruled.rules) return;
    if (bytes_of(problems.galerkin, next) > most_bytes)
      return give_up(ruled,
                     "M is singular on what is active, and the intervals taken by stages are too many for the "
                     "memory; take fewer steps");
    ruled.rules = std::move(next);
    solve_again(scene, problems, solver, z, ruled);
    if (ruled.reduced.status != Status::solved) return;
    z = ruled.elimination->recovered(ruled.reduced.z, ruled.reduced.x);
  }
  give_up(ruled,
          "M is singular on what is active, and where the state jumps changes from one solution to the next; "
          "take more steps");
}

}  // namespace

std::optional<RuledSolution> solve_by_rules(const Scene& scene, const GalerkinProblem& p,
                                            const FreeElimination& elimination, const GalerkinSolution& first,
                                            const GalerkinSolver& solver, const Options& options) {
  if (elimination.reduced().unknowns() == 0 || has_one_solution(selection_class(scene.M, scene.lcp_class)))
    return std::nullopt;
  RuleChoice choice(scene);
  const bool failed = ended_early(first);
  if (!failed && (first.status != Status::solved || !any_rule_needed(choice, first.z))) return std::nullopt;
  const RuledProblems problems(scene, p);
  RuledSolution ruled;
  ruled.reduced.lcp = first.lcp;
  if (p.initial_value) {
    const ReducedProblems reduced(problems, scene.free_rows);
    ruled.reduced = march_by_rules(reduced, choice, options, ruled.rules);
    if (failed && ruled.reduced.status != Status::solved) return std::nullopt;
    set_problem(scene, mixed_problem(problems, ruled.rules), ruled);
    return ruled;
  }
  if (failed) {
    if (!solve_by_one_rule(scene, problems, solver, ruled)) return std::nullopt;
  } else {
    ruled.rules.assign(std::size_t(p.N), IntervalRule::galerkin);
    set_problem(scene, p, ruled);
    ruled.reduced = first;
  }
  settle(scene, problems, solver, choice, ruled.elimination->recovered(ruled.reduced.z, ruled.reduced.x), ruled);
  return ruled;
}

std::string described(const std::vector<IntervalRule>& rules, const Vector& t) {
  const auto first =
      std::find_if(rules.begin(), rules.end(), [](IntervalRule r) { return r != IntervalRule::galerkin; });
  if (first == rules.end()) return "";
  const auto radau = std::count(rules.begin(), rules.end(), IntervalRule::radau),
             euler = std::count(rules.begin(), rules.end(), IntervalRule::euler);
  std::string words = text("; M is singular on what is active at t = %.6g:", t[first - rules.begin()]);
  if (radau > 0) words += text(" %ld intervals are taken by Radau IIA", long(radau));
  if (euler > 0) {
    const auto at = std::find(rules.begin(), rules.end(), IntervalRule::euler);
    words += text("%s %ld by implicit Euler, of first order, where the state may jump (first at t = %.6g)",
                  radau > 0 ? " and" : "", long(euler), t[at - rules.begin()]);
  }
  return words;
}

}  // namespace bromwich
