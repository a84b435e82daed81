#include "app/circuit_output.hpp"

#include <numeric>

namespace bromwich::app {

Scene output_scene(const Circuit& circuit) {
  const Index p = Index(circuit.outputs.size());
  Scene scene;
  scene.name = circuit.scene.name;
  scene.dynamics = DenseDynamics{Matrix::Zero(p, p), Matrix::Zero(p, 0), Matrix::Zero(0, p)};
  scene.M = Matrix::Zero(0, 0);
  scene.x0 = Vector::Zero(p);
  scene.T = circuit.scene.T;
  scene.time_unit = circuit.scene.time_unit;
  for (const CircuitOutput& output : circuit.outputs) {
    scene.names.x.push_back(output.name);
    scene.units.x.push_back(output.unit);
  }
  return scene;
}

Result output_result(const Circuit& circuit, const Result& result) {
  Result rows = result;
  rows.x = output_values(circuit, result);
  rows.x_components.resize(circuit.outputs.size());
  std::iota(rows.x_components.begin(), rows.x_components.end(), Index(0));
  rows.y.resize(result.t.size(), 0);
  rows.trace.resize(0, 0);
  rows.y_left.resize(0, 0);
  rows.y_integral.resize(0, 0);
  return rows;
}

}  // namespace bromwich::app
