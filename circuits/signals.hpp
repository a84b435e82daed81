#pragma once
// The numbers of the signals s = (x, y, u, d) of a network.

#include "circuits/normal_tree.hpp"

#include <vector>

namespace bromwich::circuits {

/// Signals of one element; -1: it has none.
struct OwnSignals {
  Index storage = -1;     ///< its row of K s' = d
  Index signal = -1;      ///< x, or d of an element in excess
  Index y = -1, y2 = -1;  ///< among the multipliers
  Index source = -1;      ///< among u
};

struct Signals {
  std::vector<OwnSignals> own;  ///< by element
  std::vector<Index> storage;   ///< elements: those of the states, then those in excess
  std::vector<Index> inputs;    ///< elements V and I; their u are 1, 2, ...
  std::vector<Index> memories;  ///< elements with modes; their u are the last, 0 off and 1 on
  Index states = 0, pairs = 0, excess = 0;
  Index sources = 1;  ///< u_0 is the constant 1; bounds of gates are behind the inputs
  Index count() const { return states + pairs + sources + excess; }
  Index of_y(Index i) const { return states + i; }
  Index of_u(Index i) const { return states + pairs + i; }
};

/// `remembers`: of switches, whether the circuit changes their mode.
Signals number_signals(const Netlist&, const NormalTree&, const std::vector<char>& remembers);

}  // namespace bromwich::circuits
