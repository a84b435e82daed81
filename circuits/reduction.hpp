#pragma once
// From a netlist to the matrices of its complementarity system.
//
// The network is solved for the signals s = (x, y, u, d) (circuits/network.hpp). Storage elements have K s' = d, with
// s the voltage of a capacitor or the current of an inductor, and d its current or voltage. Those in a loop of
// capacitors and voltage sources, or in a cutset of inductors and current sources, are in excess: s_t = P x + Q u. With
//
//     d_c = V_x x + V_y y + V_u u + V_d d_t,     d_t = (K_tc + K_tt P) x' + K_tt Q u',
//     (K_cc + K_ct P - V_d (K_tc + K_tt P)) x' = V_x x + V_y y + V_u u + (V_d K_tt - K_ct) Q u'
//
// the state z = x - H u takes u' away: z' = A z + B y + (E^{-1} V_u + A H) u.

#include "circuits/netlist.hpp"
#include "circuits/network.hpp"

#include <string>
#include <vector>

namespace bromwich::circuits {

/// Rows over (z, y, u, u').
struct Forms {
  Rows z, y, u, slope;
};

/// A switch that is opened and closed by sources.
struct Gate {
  Index element = 0;
  Index source = 0;     ///< its number in u
  double open, closed;  ///< values of this source: a bound
  Terms control;        ///< the control signal over u
};

/// An element whose voltage or current the others determine.
struct Dependence {
  enum Kind : char { loop, cutset, winding } kind;  ///< of capacitors and voltages; of inductors and currents
  std::string equation;                             ///< "V(C2) = V1 - V(C1)"
};

struct Reduction {
  Rows A, B, F;                     ///< z' = A z + B y + F u
  std::vector<std::string> pairs;   ///< of the element, "D1", "S1.p"
  Forms w;                          ///< one row a pair
  std::vector<std::string> states;  ///< "V(C1)", "I(L1)"
  std::vector<Index> storage;       ///< elements of the states
  Rows H;                           ///< x = z + H u
  std::vector<Index> excess;        ///< elements that store as others do: s = P x + Q u
  Rows P, Q;
  Rows jump;  ///< the charges and fluxes that s is off by at a start change x: x += jump (P x + Q u - s)
  std::vector<Index> inputs;  ///< elements of the sources u_1, ..., in this order; gates behind
  Index sources = 0;          ///< length of u
  std::vector<Gate> gates;
  std::vector<Index> memories;       ///< switches and thyristors with modes; the last of u, 0 off and 1 on
  Forms conditions;                  ///< two rows each: off is left where the first is positive, on where the second is
  std::vector<std::string> outputs;  ///< V of all nodes but ground, then I of all elements; without hidden ones
  Index nodes = 0;                   ///< how many of the outputs are V
  Forms of_outputs;
  std::vector<Dependence> dependences;
  std::vector<std::string> open;  ///< diodes and switches without a parallel resistance: "D1"
  std::vector<std::string> notes;
};

/// Throws Error naming file, line and element where the network has no unique solution.
Reduction reduce(const Netlist&);

}  // namespace bromwich::circuits
