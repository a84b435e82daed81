#pragma once
// f and g of the scene of a structure with contacts, lines between breakpoints where all that they are made of is.

#include "bromwich/mechanics.hpp"

#include <Eigen/Cholesky>

#include <memory>
#include <vector>

namespace bromwich {

/// m values: forces M^-1 f, and what contacts with a given bound and Jenkins elements bring. `mass`: of a dense scene;
/// null: forces themselves, with E. Empty: 0.
TimeFunction source_of_states(const Structure&, const std::shared_ptr<const std::vector<Contact>>&,
                              const std::vector<ContactRows>&, Index m,
                              const std::shared_ptr<const Eigen::LLT<Matrix>>& mass);

/// n values: gaps, velocities of other bodies, bounds. Empty: 0.
TimeFunction source_of_rows(const std::shared_ptr<const std::vector<Contact>>&, const std::vector<ContactRows>&);

}  // namespace bromwich
