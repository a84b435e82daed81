#pragma once
// What is wrong with a structure or a contact as it was given.

#include "bromwich/mechanics.hpp"

namespace bromwich {

/// Throws Error naming a member, "M" or "contacts[1].mu". Names of contacts are those that the scene will have.
void check_structure(const Structure&);
void check_contacts(const Structure&, const std::vector<Contact>&);

}  // namespace bromwich
