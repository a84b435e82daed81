#include "app/circuit_output.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <numeric>

namespace bromwich::app {

Scene output_scene(const Circuit& circuit, const std::vector<Probe>& probes) {
  const Index p = Index(circuit.outputs.size() + probes.size());
  Scene scene;
  scene.name = circuit.scene.name;
  scene.dynamics = DenseDynamics{Matrix::Zero(p, p), Matrix::Zero(p, 0), Matrix::Zero(0, p)};
  scene.M = Matrix::Zero(0, 0);
  scene.x0 = Vector::Zero(p);
  scene.T = circuit.scene.T;
  scene.memories = circuit.scene.memories;
  scene.time_unit = circuit.scene.time_unit;
  for (const CircuitOutput& output : circuit.outputs) {
    scene.names.x.push_back(output.name);
    scene.units.x.push_back(output.unit);
  }
  for (const Probe& probe : probes) {
    scene.names.x.push_back(probe.label());
    scene.units.x.push_back(probe.unit());
  }
  return scene;
}

Result output_result(const Circuit& circuit, const Result& result, const std::vector<Probe>& probes) {
  Result rows = result;
  const RowMatrix values = output_values(circuit, result);
  rows.x.resize(values.rows(), values.cols() + Index(probes.size()));
  rows.x.leftCols(values.cols()) = values;
  for (std::size_t k = 0; k < probes.size(); ++k) rows.x.col(values.cols() + Index(k)) = probes[k](result.t, values);
  rows.x_components.resize(std::size_t(rows.x.cols()));
  std::iota(rows.x_components.begin(), rows.x_components.end(), Index(0));
  rows.y.resize(result.t.size(), 0);
  rows.trace.resize(0, 0);
  rows.y_left.resize(0, 0);
  rows.y_integral.resize(0, 0);
  return rows;
}

std::vector<Column> circuit_columns(const std::string& words, const Circuit& circuit, std::vector<Probe>& probes) {
  std::vector<Column> columns;
  std::string word;
  int depth = 0;
  const auto take = [&] {
    Column next{ColumnKind::x, -1, word};
    for (std::size_t k = 0; k < circuit.scene.memories.size(); ++k)
      if (circuit.scene.memories[k].name == word) next = {ColumnKind::mode, Index(k), word};
    for (std::size_t i = 0; i < circuit.outputs.size(); ++i)
      if (circuit.outputs[i].name == word) next.component = Index(i);
    if (next.component < 0) {
      probes.emplace_back(circuit, word, "--columns");
      next.name = probes.back().label();
      next.component = Index(circuit.outputs.size() + probes.size()) - 1;
    }
    for (const Column& column : columns)
      if (column.name == next.name)
        throw Error("--columns", fmt::format("{} is given twice", next.name), "give each column once");
    columns.push_back(next);
    word.clear();
  };
  for (const char c : words) {
    depth += int(c == '(') - int(c == ')');
    if (c == ',' && depth == 0)
      take();
    else if (c != ' ')
      word += c;
  }
  take();
  return columns;
}

CircuitNumbers circuit_numbers(const Circuit& circuit, Backend& backend, const Result& result) {
  CircuitNumbers found;
  if (result.status != Status::solved || result.x.cols() != circuit.scene.states()) return found;
  found.measures = measured(circuit, backend, result);
  if (!circuit.scene.boundary) return found;
  const CircuitWaveforms waveforms(circuit, backend, result, 0, circuit.scene.T, "--periodic");
  for (const CircuitOutput& output : circuit.outputs)
    found.outputs.push_back(numbers(Probe(circuit, output.name, "--periodic"), waveforms));
  found.balance = balance(circuit, waveforms);
  return found;
}

std::string circuit_text(const CircuitNumbers& n) {
  std::string text;
  const auto line = [&text](const std::string& label, const std::string& value) {
    fmt::format_to(std::back_inserter(text), "{:<11} {}\n", label, value);
  };
  for (const MeasuredValue& m : n.measures)
    line("measure", std::isfinite(m.value) ? fmt::format("{} = {:.9g} {}", m.name, m.value, m.unit)
                                           : fmt::format("{}: {}", m.name, m.found));
  for (const OutputNumbers& o : n.outputs)
    line(o.name, fmt::format("mean {:.9g} {}, rms {:.9g}, ripple {:.6g} ({:.9g} to {:.9g}){}", o.mean, o.unit, o.rms,
                             o.max - o.min, o.min, o.max,
                             std::isnan(o.distortion) ? "" : fmt::format(", THD {:.4g} %", 100 * o.distortion)));
  if (!n.balance) return text;
  const CircuitBalance& b = *n.balance;
  const double span = b.to - b.from;
  for (const ElementPower& e : b.elements)
    if (e.kind != 'C' && e.kind != 'L')
      line("power " + e.name, fmt::format("{:.6g} W{}", std::abs(e.power), e.power < 0 ? " supplied" : ""));
  line("energy", fmt::format("supplied {:.9g} W, dissipated {:.9g} W, stored {:.3g} W, balance to {:.1e}",
                             b.supplied / span, b.dissipated / span, b.stored / span, b.error));
  if (!b.load.empty() && b.supplied > 0)
    line("efficiency", fmt::format("{:.6g} % into {}", 100 * b.efficiency, b.load));
  return text;
}

void add_circuit_json(const CircuitNumbers& n, Json& object) {
  for (const MeasuredValue& m : n.measures)
    object["measures"][m.name] = {{"value", std::isfinite(m.value) ? Json(m.value) : Json(nullptr)}, {"unit", m.unit}};
  for (const OutputNumbers& o : n.outputs)
    object["outputs"][o.name] = {{"unit", o.unit},
                                 {"mean", o.mean},
                                 {"rms", o.rms},
                                 {"min", o.min},
                                 {"max", o.max},
                                 {"fundamental", o.fundamental},
                                 {"thd", std::isnan(o.distortion) ? Json(nullptr) : Json(o.distortion)}};
  if (!n.balance) return;
  const CircuitBalance& b = *n.balance;
  Json elements = Json::object();
  for (const ElementPower& e : b.elements)
    elements[e.name] = {{"power", e.power}, {"mean", e.mean}, {"rms", e.rms}, {"peak", e.peak}};
  object["balance"] = {{"from", b.from},
                       {"to", b.to},
                       {"supplied", b.supplied},
                       {"stored", b.stored},
                       {"dissipated", b.dissipated},
                       {"error", b.error},
                       {"load", b.load},
                       {"efficiency", b.efficiency},
                       {"elements", elements}};
}

}  // namespace bromwich::app
