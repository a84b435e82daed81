#pragma once
// A netlist as a linear complementarity system with outputs.
//
//     x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,     V(node), I(element) = rows of (x, y, u, u')
//
// symbol  meaning
// x       voltages of capacitors and currents of inductors, without those that the others determine (excess elements)
// y, w    of a diode its current and its blocked voltage beyond the line v = V* + R' i; of a switch two multipliers
// u       sources: 1, the independent ones, and the bounds of gated switches
// modes   of switches that the circuit controls, and of thyristors: 0 off, 1 on. They are the memories of the scene
//
// Ideal elements: diodes are two straight lines, switches two resistances, and junctions have no capacitance.

#include "circuits/netlist.hpp"
#include "core/result/result.hpp"
#include "core/scene/scene.hpp"

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

/// A quantity of a circuit.
struct CircuitOutput {
  std::string name, unit;  ///< "V(out)", "V"; "I(L1)", "A": into the first node of the element
};

/// An element with two nodes, by the numbers of outputs.
struct CircuitElement {
  std::string name;
  char kind = 'R';           ///< R C L V I E G F H D S W B
  Index from = -1, to = -1;  ///< V of its first and second node; -1: ground
  Index current = 0;         ///< I
};

/// An entry of C or L between two elements: energy Σ value q_a q_b / 2, q the voltage of a capacitor or the current of
/// an inductor.
struct CircuitStore {
  Index a = 0, b = 0;
  double value = 0;
};

/// What the reduction has found.
struct CircuitReduction {
  std::string summary;                ///< "7 elements, 4 nodes: 2 states, 3 pairs, 2 sources"
  std::vector<std::string> states;    ///< "V(C1)", "I(L1)"
  std::vector<std::string> pairs;     ///< "D1", "S1.p"
  std::vector<std::string> loops;     ///< capacitors in loops with voltage sources: "V(C2) = V1 - V(C1)"
  std::vector<std::string> cutsets;   ///< inductors in cutsets with current sources: "I(L2) = -I(L1)"
  std::vector<std::string> windings;  ///< inductors with K = 1: "V(L2) = 3 V(L1)"
  std::vector<std::string> open;      ///< diodes and switches without a parallel resistance
};

/// A line .meas, as it is written.
struct MeasureCard {
  std::string where;  ///< "buck.cir: line 12"
  std::string text;
};

struct Circuit {
  Scene scene;
  std::vector<CircuitOutput> outputs;                 ///< V of all nodes, then I of all elements that are written
  SparseMatrix of_x, of_y, of_u, of_slope, of_modes;  ///< a row for each output, over (x, y, u, u', modes)
  std::vector<CircuitElement> elements;
  std::vector<CircuitStore> stores;
  TimeFunction u, slope;           ///< k values each
  std::vector<double> kinks;       ///< where one of them may jump or have a kink, also one that x and y do not see
  Index sources = 0;               ///< k
  Vector times;                    ///< of .tran: start to stop; empty: no step is given
  std::vector<std::string> notes;  ///< what was skipped, straightened or added, one line each
  CircuitReduction reduction;
  std::vector<MeasureCard> measures;
  std::vector<CircuitStep> steps;  ///< nested loops, the last one is the innermost; without those that settings fix
  std::map<std::string, double> parameters;
  std::vector<std::filesystem::path> inputs;
  std::shared_ptr<const circuits::Netlist> netlist;  ///< what it is made from
};

/// The circuit of a netlist with its subcircuits written out; `file` is its name in messages.
Circuit make_circuit(const circuits::Netlist&, const std::string& file);

/// Reads a netlist; see docs/netlists.md. `settings` replace its .param. `period`: the scene is the periodic state with
/// this period, x(0) = x(T), or with the least common one of the sources where it is 0. Throws Error naming file, line
/// and element.
Circuit read_circuit(const std::filesystem::path& file, const std::map<std::string, double>& settings = {},
                     std::optional<double> period = {});
/// The same from text. `folder`: where .include looks.
Circuit parse_circuit(std::string_view netlist, const std::string& file_name, const std::filesystem::path& folder = {},
                      const std::map<std::string, double>& settings = {}, std::optional<double> period = {});

/// Whether the name of a file is that of a netlist: .cir, .net, .sp, .ckt, .spice.
bool is_netlist(const std::filesystem::path& file);

/// rows x outputs at the times of a result with all states; NaN where it has no value.
RowMatrix output_values(const Circuit&, const Result&);

}  // namespace bromwich
