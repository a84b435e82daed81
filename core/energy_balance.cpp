#include "core/energy_balance.hpp"

#include "core/constrained_path.hpp"
#include "core/row_products.hpp"

namespace bromwich {

EnergyBalance energy_balance(const Trajectory& path) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const Vector h = path.t.tail(M) - path.t.head(M);
  EnergyBalance b{Vector(M + 1), Vector::Zero(M), Vector::Zero(M), Vector(M)};
  b.energy = 0.5 * row_forms(path.x, system.energy_matrix(), path.x);
  const auto& [nodes, weights] = quadrature(path.scheme);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const bool at_end = path.scheme == StepScheme::euler;  // x there is that of the right end
    const RowMatrix within = at_end ? RowMatrix() : states_within(path, nodes[q]);
    const Eigen::Ref<const RowMatrix> x = at_end ? path.x.bottomRows(M) : within.topRows(M);
    b.dissipated += weights[q] * h.cwiseProduct(row_forms(x, system.dissipation_matrix(), x));
    if (!system.port().u) continue;
    const RowMatrix u = system.inputs(path.t, nodes[q]);
    b.supplied += weights[q] * h.cwiseProduct(row_forms(x, system.output_matrix(), u));
  }
  if (path.constraints) b.supplied += constraint_supply(path);
  b.violation = b.dissipated - b.supplied + b.energy.tail(M) - b.energy.head(M);
  return b;
}

PowerBalance power_balance(const Trajectory& path, const RowMatrix& y, const RowMatrix& port_matrix) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const RowMatrix& x = path.x;
  PowerBalance p{Vector::Zero(M + 1), row_forms(x, system.dissipation_matrix(), x)};
  if (system.port().u) {
    const RowMatrix outputs = row_products(x, system.output_matrix());
    p.supplied.tail(M) = outputs.bottomRows(M).cwiseProduct(system.inputs(path.t, 1)).rowwise().sum();
    p.supplied[0] = outputs.row(0).dot(system.inputs(path.t.head(2), 0).row(0));
  }
  if (y.size() > 0) p.supplied += (x * port_matrix).cwiseProduct(y).rowwise().sum();
  return p;
}

RowMatrix balance_gradient(const Trajectory& path, const Vector& w) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const Vector h = path.t.tail(M) - path.t.head(M);
  RowMatrix gradient = RowMatrix::Zero(M + 1, path.x.cols());
  Vector of_energy = Vector::Zero(M + 1);  // the energy of a point ends one step and begins the next
  of_energy.tail(M) += w;
  of_energy.head(M) -= w;
  add_row_products(of_energy, path.x, system.energy_matrix(), gradient);  // dH/dx
  const SparseMatrix inputs = system.output_matrix().transpose();
  const auto& [nodes, weights] = quadrature(path.scheme);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const Vector wh = weights[q] * w.cwiseProduct(h);
    const auto add = [&](const Eigen::Ref<const RowMatrix>& x, Eigen::Ref<RowMatrix> g) {
      add_row_products(2 * wh, x, system.dissipation_matrix(), g);
      if (system.port().u) add_row_products(-wh, system.inputs(path.t, nodes[q]), inputs, g);
    };
    if (path.scheme == StepScheme::euler) {  // x there is that of the right end
      add(path.x.bottomRows(M), gradient.bottomRows(M));
      continue;
    }
    RowMatrix g = RowMatrix::Zero(M, path.x.cols());
    add(states_within(path, nodes[q]), g);
    add_within(path, nodes[q], g, gradient);
  }
  if (path.constraints) add_constraint_supply(path, -w, gradient);
  return gradient;
}

}  // namespace bromwich
