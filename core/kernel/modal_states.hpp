#pragma once

#include "discrete_problem.hpp"

#include <vector>

namespace bromwich {

/// Requested components of the states of a Kronecker sum from y: (J+1) x components, row 0 = x0.
RowMatrix modal_states(const DiscreteProblem&, Rule, const RowMatrix& y, const std::vector<Index>& components);

}  // namespace bromwich
