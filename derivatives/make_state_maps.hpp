#pragma once

#include "../core/kernel/discrete_problem.hpp"
#include "state_maps.hpp"

#include <memory>

namespace bromwich {

/// Of the dynamics and the grid of a problem, neither of which may go before this. Dense: by steps. Kronecker sums: in
/// modes. Others: `seen` by the windows of contours that cover all time points, states by steps of one contour.
std::unique_ptr<StateMaps> make_state_maps(const DiscreteProblem&);

}  // namespace bromwich
