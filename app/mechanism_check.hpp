#pragma once
// What `bromwich check` says of a structure with contacts.

#include "app/output_json.hpp"
#include "mechanics/mechanism.hpp"

#include <string>
#include <utility>
#include <vector>

namespace bromwich::app {

/// Lines of text, (label, fact).
std::vector<std::pair<std::string, std::string>> mechanism_facts(const Mechanism&);

/// "coordinates", "unique", and "contacts" with what each is.
Json mechanism_json(const Mechanism&);

}  // namespace bromwich::app
