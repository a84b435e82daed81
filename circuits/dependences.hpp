#pragma once
// What the reduction says of elements that others determine.

#include "circuits/normal_tree.hpp"
#include "circuits/reduction.hpp"

namespace bromwich::circuits {

/// Loops and cutsets by P and Q of the reduction, windings by their ratios.
std::vector<Dependence> dependences(const Netlist&, const NormalTree&, const Reduction&);

}  // namespace bromwich::circuits
