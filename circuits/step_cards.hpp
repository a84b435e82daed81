#pragma once
// .step cards: values of a parameter, for which a netlist is solved again.
//
//     .step [lin] param NAME first last increment      .step dec|oct param NAME first last points
//     .step param NAME list v1 v2 ...

#include "circuits/netlist.hpp"

#include <string>

namespace bromwich::circuits {

/// The parameter of a card, in lower case; empty: it steps something else, a source or a temperature.
std::string stepped_parameter(const Card&);

/// The values of a card with a parameter. Throws Error naming the place.
CircuitStep read_step(const Card&, const Parameters&);

}  // namespace bromwich::circuits
