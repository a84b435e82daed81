#pragma once
// The normal tree of a network: which elements state voltages (in the tree) and which state currents.

#include "circuits/network.hpp"
#include "circuits/windings.hpp"

#include <map>
#include <string>
#include <vector>

namespace bromwich::circuits {

struct NormalTree {
  std::vector<char> in_tree;         ///< by element
  std::vector<char> follows;         ///< by element: an inductor that follows others as an ideal winding
  std::vector<WindingGroup> groups;  ///< with the bases that were chosen
  std::vector<Index> grounded;       ///< a node of each part that had no path to ground
};

/// Nodes by name, "0" first.
std::map<std::string, Index> number_nodes(const Netlist&);

/// Whether a diode or switch has no parallel resistance.
bool opens(const Element&);
/// Takes Roff above 1e7 ohm away from diodes and switches, but where nothing else joins their ends: there it states the
/// voltage between two parts of the circuit. Returns the names of these elements.
std::vector<std::string> open_large_resistances(Netlist&, const std::map<std::string, Index>& nodes);

/// In the order V, E, H, ideal windings; C; R; open switches and diodes; L; I, F, G. Throws Error naming the element
/// where voltage sources close a loop, or current sources alone lead to a node.
NormalTree normal_tree(const Netlist&, const std::map<std::string, Index>& nodes);

}  // namespace bromwich::circuits
