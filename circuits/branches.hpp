#pragma once
// Elements as branches of a linear network.

#include "circuits/signals.hpp"

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::circuits {

struct Branches {
  std::vector<Branch> all;
  std::vector<std::pair<Index, Index>> of;  ///< by element: its first branch, and how many it has
};

/// Throws Error naming an element that is controlled by a source which is not there.
Branches make_branches(const Netlist&, const std::map<std::string, Index>& nodes, const NormalTree&, const Signals&);

/// V* and R' of the line beyond which a diode conducts.
std::pair<double, double> conducting_line(const Element& diode);

/// By element, where it is an inductor of a base: the windings that follow it, with their ratios.
std::vector<Terms> followers(const Netlist&, const NormalTree&);

/// By its name in lower case. Throws Error naming the element that `asks` for one that is not there.
Index element_named(const Netlist&, const std::string& name, const Element& asks);

/// By the name of a voltage source, in lower case: its element.
std::map<std::string, Index> voltage_sources(const Netlist&);

}  // namespace bromwich::circuits
