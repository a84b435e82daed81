#pragma once
// The cards of a netlist by levels: its own, and those of subcircuits.

#include "circuits/cards.hpp"

#include <map>
#include <string>
#include <vector>

namespace bromwich::circuits {

struct Subcircuit {
  Card card;
  std::vector<std::string> nodes;
  std::map<std::string, std::string> defaults;
  std::vector<Card> cards;
  std::map<std::string, Subcircuit> inner;
};

/// The cards of one level, with the subcircuits that it defines.
struct Level {
  std::vector<Card> cards;
  std::map<std::string, Subcircuit> subcircuits;
};

/// Throws Error naming the place of a .subckt or .ends without the other.
Level sort_cards(const std::vector<Card>&);

/// The subcircuits that every netlist may call.
const Level& library_level();

}  // namespace bromwich::circuits
