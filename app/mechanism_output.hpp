#pragma once
// What is computed of a solved result of a structure with contacts.

#include "app/output_json.hpp"
#include "files/result_file.hpp"
#include "mechanics/mechanism.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich::app {

/// Where the result has one. Adds to its summary the objects "contacts": of each contact its numbers, phases
/// and impacts; "energy"; and the number "coordinates".
std::optional<ContactReport> report_on_contacts(const Mechanism&, const Result&, Json& object);

/// The names of columns of contacts; without a mechanism none.
std::vector<std::string> contact_names(const Mechanism*);

/// The columns of contacts at these rows of it.
std::vector<TimeSeries> contact_series(const Mechanism&, const ContactReport&, const Result& rows);

/// Lines for the summary: each contact with its times, impulses and losses, and the balance of energy.
std::string mechanism_text(const Mechanism&, const ContactReport&);

}  // namespace bromwich::app
