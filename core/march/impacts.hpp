#pragma once
// March of structures with rigid contacts whose scene states coefficients of restitution: steps divided at located
// impacts (impact_steps.hpp). Order 2 in positions, whatever the coefficients.

#include "../kernel/discrete_problem.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"
#include "impact_rows.hpp"

namespace bromwich {

/// The rows of the scene. Nothing: it is marched otherwise, since rows are of other kinds, x0 is beyond a contact, or a
/// step is very long beside 1 / |A|.
std::optional<ImpactRows> rows_of_impacts(const DiscreteProblem&);

/// Whether coefficients are above 0, or friction is on circles: other steps would take impacts as without, and cones as
/// orthants.
bool needs_location(const DiscreteProblem&);
/// Where such a scene has no rows.
void refuse_impacts(Result&);

/// Fills the result as solve_by_stages does.
void solve_over_impacts(const DiscreteProblem&, const ImpactRows&, const Options&, Result&);

}  // namespace bromwich
