#pragma once
// Whether steps of a solution have other solutions. A result reports them.

#include "../kernel/discrete_problem.hpp"
#include "../result/result.hpp"

namespace bromwich {

struct OtherSolution {
  Index row = -1;                ///< of the first one that was found, of those looked at; -1: none
  bool moves_the_state = false;  ///< the state after the step is another one too
  bool searched = false;         ///< all solutions; false: only those next to one, the problems are too large for more
};

/// Checks t = 0 (where M is neither P nor PSD) and up to 24 steps: the first, those at which the active set changes,
/// and some between them. Each is a problem of implicit Euler that starts from the state of the result. Dense dynamics;
/// x all states.
OtherSolution other_solution(const DiscreteProblem&, const Result&, const RowMatrix& x, bool at_corners = false);

}  // namespace bromwich
