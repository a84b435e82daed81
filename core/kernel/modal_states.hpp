#pragma once

#include "discrete_problem.hpp"

#include <vector>

namespace bromwich {

/// The states of a Kronecker sum behind y, chosen components: (J+1) x components, row 0 = x0.
RowMatrix modal_states(const DiscreteProblem&, Rule, const RowMatrix& y, const std::vector<Index>& components);

}  // namespace bromwich
