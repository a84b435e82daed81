#pragma once
// What is computed of a solved result of a structure with contacts.

#include "app/output_json.hpp"
#include "mechanics/mechanism.hpp"

#include <string>

namespace bromwich::app {

/// Lines for the summary: each contact with its times, impulses and losses, and the balance of energy.
std::string mechanism_text(const Mechanism&, const ContactReport&);

/// The object "contacts": of each contact its numbers, phases and impacts; and "energy".
void add_mechanism_json(const Mechanism&, const ContactReport&, Json& object);

}  // namespace bromwich::app
