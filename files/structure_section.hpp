#pragma once
// [structure] and [[contact]] of a scene file: a mechanical structure with contacts.

#include "files/scene_draft.hpp"
#include "mechanics/mechanism.hpp"

#include <memory>

namespace bromwich {

/// The structure of the file with its contacts, and the relays of [relay] beside them. The switch times of its sources
/// are noted in the draft, whose T is known. Throws Error for sections that say the same.
std::shared_ptr<const Mechanism> read_mechanism(const Sections&, Draft&);

}  // namespace bromwich
