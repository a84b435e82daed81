#pragma once
// Sections of scene files with what is known or wanted of a solution: [reference] and [quantity].

#include "files/scene_file.hpp"
#include "files/section.hpp"

#include <memory>
#include <optional>
#include <string>

namespace bromwich {

/// Throws where a function is given that has another number of entries.
void require_entries(const FunctionValue& value, Index expected, const std::string& where, const char* meaning);

/// None where the section is not given.
std::optional<Reference> read_reference(const Section& section, const Scene& scene);

/// Null where the section is not given.
std::shared_ptr<const QuantityOfInterest> read_quantity(const Section& section, const Scene& scene);

}  // namespace bromwich
