#include "derivatives/quantity_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

namespace bromwich {

namespace {

// For quantities of t and x alone.
PortHamiltonian without_structure(Index states) {
  PortHamiltonian port;
  port.J = port.R = SparseMatrix(states, states);
  port.B = SparseMatrix(states, 0);
  return port;
}

}  // namespace

QuantityChange quantity_change(const QuantityOfInterest& quantity, const Scene& scene, const Vector& t,
                               const RowMatrix& x) {
  if (x.rows() != t.size() || x.cols() != scene.states())
    throw Error("x", text("is %ld x %ld", long(x.rows()), long(x.cols())),
                text("give all states at the times, %ld x %ld", long(t.size()), long(scene.states())));
  const bool of_energy = quantity.name() == "glob" || quantity.name().starts_with("loc");
  if (of_energy && !scene.port)
    throw Error("quantity", "the scene has no energy balance", "give a port-Hamiltonian scene, or another quantity");
  const PortSystem system(scene.port ? *scene.port : without_structure(scene.states()), scene.T);
  // Lines between the time points, whose squares its two nodes a step integrate exactly.
  const QuantityEvaluation found = quantity.evaluate(Trajectory{system, StepScheme::midpoint, t, x}, true);
  return {found.value, {RowMatrix(), found.gradient, RowMatrix(), RowMatrix()}};
}

}  // namespace bromwich
