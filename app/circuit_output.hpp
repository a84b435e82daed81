#pragma once
// The outputs of a circuit, V(node) and I(element), as the states of a scene without constraints: files, pages and
// columns of results take them as they take any states. And what is computed of a result besides.

#include "app/columns.hpp"
#include "app/output_json.hpp"
#include "circuits/balance.hpp"
#include "circuits/circuit.hpp"
#include "circuits/measures.hpp"
#include "circuits/probe.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// Names, units and T; its dynamics do nothing. `probes`: further outputs.
Scene output_scene(const Circuit&, const std::vector<Probe>& probes);

/// The rows of a result with all states.
Result output_result(const Circuit&, const Result&, const std::vector<Probe>& probes);

/// The words of --columns, names of outputs; others become probes behind the outputs: "V(a,b)", "P(R1)",
/// "V(out)*I(R1)".
std::vector<Column> circuit_columns(const std::string& words, const Circuit&, std::vector<Probe>& probes);

/// What is computed of a solved result: .meas cards, and of a periodic state all outputs and where the energy goes.
struct CircuitNumbers {
  std::vector<MeasuredValue> measures;
  std::vector<OutputNumbers> outputs;
  std::optional<CircuitBalance> balance;
};
CircuitNumbers circuit_numbers(const Circuit&, Backend&, const Result&);

/// Lines for the summary, and the objects "measures", "outputs" and "balance".
std::string circuit_text(const CircuitNumbers&);
void add_circuit_json(const CircuitNumbers&, Json& object);

}  // namespace bromwich::app
