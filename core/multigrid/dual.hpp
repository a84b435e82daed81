#pragma once
// Cycles in w where M is small, singular or zero: the multigrid of core/multigrid/multigrid.hpp on the grids of
// core/multigrid/dual_levels.hpp. The result is the pair
//
//     y = max(0, V w + s),   w = M y + r + K y,
//
// the second with K of implicit Euler itself: residual and certificates judge it, whatever the errors of V.

#include "../kernel/prepared_method.hpp"
#include "../kernel/time_operator.hpp"

#include <string>

namespace bromwich {

/// Running it sets the same members as the cycles in y, with Result::form. Null if there is no V, no grid below the
/// finest one, or M without a solution at t = 0; `why` says so.
std::unique_ptr<PreparedMethod> prepare_dual(TimeOperator&, const Options&, std::string& why);

}  // namespace bromwich
