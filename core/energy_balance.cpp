#include "core/energy_balance.hpp"

#include "core/constrained_path.hpp"

namespace bromwich {

EnergyBalance energy_balance(const Trajectory& path) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const Vector h = path.t.tail(M) - path.t.head(M);
  EnergyBalance b{Vector(M + 1), Vector::Zero(M), Vector::Zero(M), Vector(M)};
  b.energy = 0.5 * (path.x * system.energy_matrix()).cwiseProduct(path.x).rowwise().sum();
  const auto& [nodes, weights] = quadrature(path.scheme);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const RowMatrix x = states_within(path, nodes[q]);
    const Vector lost = (x * system.dissipation_matrix()).cwiseProduct(x).rowwise().sum();
    b.dissipated += weights[q] * h.cwiseProduct(lost);
    if (!system.port().u) continue;
    const Vector gained = (x * system.output_matrix()).cwiseProduct(system.inputs(path.t, nodes[q])).rowwise().sum();
    b.supplied += weights[q] * h.cwiseProduct(gained);
  }
  if (path.constraints) b.supplied += constraint_supply(path);
  b.violation = b.dissipated - b.supplied + b.energy.tail(M) - b.energy.head(M);
  return b;
}

PowerBalance power_balance(const Trajectory& path, const RowMatrix& y, const RowMatrix& port_matrix) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const RowMatrix& x = path.x;
  PowerBalance p{Vector::Zero(M + 1), (x * system.dissipation_matrix()).cwiseProduct(x).rowwise().sum()};
  if (system.port().u) {
    const RowMatrix outputs = x * system.output_matrix();
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
  const RowMatrix effort = path.x * system.energy_matrix();  // dH/dx
  gradient.bottomRows(M) += w.asDiagonal() * effort.bottomRows(M);
  gradient.topRows(M) -= w.asDiagonal() * effort.topRows(M);
  const auto& [nodes, weights] = quadrature(path.scheme);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    RowMatrix g = 2 * states_within(path, nodes[q]) * system.dissipation_matrix();
    if (system.port().u) g -= system.inputs(path.t, nodes[q]) * system.output_matrix().transpose();
    g = (weights[q] * w.cwiseProduct(h)).asDiagonal() * g;
    add_within(path, nodes[q], g, gradient);
  }
  if (path.constraints) add_constraint_supply(path, -w, gradient);
  return gradient;
}

}  // namespace bromwich
