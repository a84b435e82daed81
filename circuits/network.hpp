#pragma once
// Linear networks of branches between nodes, and what they are as a system in the state.
//
// Every branch states its voltage or its current:
//
//     v = a · s + R i + Σ k v(other nodes) + Σ r i(other branch),        a branch of voltage,
//     i = a · s + G v + Σ k v(other nodes) + Σ b i(other branch),        a branch of current,
//
// with s = (x, y, u, d): the states, the multipliers, the sources and what excess elements add. Modified nodal analysis
// (Ho, Ruehli, Brennan, IEEE Trans. Circuits Syst. 22, 1975) solves the network for all right sides at once; the normal
// tree (Bryant, Proc. IEE 106C, 1959) decides which elements store a state and which are in excess.

#include "circuits/rows.hpp"

#include <string>
#include <utility>
#include <vector>

namespace bromwich::circuits {

/// A sum of signals: (number, factor).
using Terms = std::vector<std::pair<Index, double>>;

struct Branch {
  bool of_voltage = false;
  Index from = 0, to = 0;  ///< nodes; 0 is ground. The current flows from `from` through the branch to `to`
  Terms signals = {};      ///< a, by the number of the signal in s
  double slope = 0;        ///< R or G
  std::vector<std::pair<std::pair<Index, Index>, double>> voltages = {};  ///< k with the nodes
  Terms currents = {};  ///< by the number of the branch, one of voltage
};

/// Voltages of all nodes and currents of all branches as linear functions of the signals: one row each.
struct NetworkSolution {
  Rows voltages;             ///< nodes x signals; row 0 is zero
  Rows currents;             ///< branches x signals
  Index singular_node = -1;  ///< where the equations are singular: a node or a branch concerned, otherwise -1
  Index singular_branch = -1;
};

/// `nodes`: ground included.
NetworkSolution solve_network(const std::vector<Branch>&, Index nodes, Index signals);

/// Sets of nodes that are joined.
class Forest {
 public:
  explicit Forest(Index nodes);
  Index root(Index node);
  /// Whether the nodes were in two sets, which are one now.
  bool join(Index a, Index b);

 private:
  std::vector<Index> parent_;
};

}  // namespace bromwich::circuits
