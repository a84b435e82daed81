#include "core/goal/energy_balance.hpp"

#include "core/goal/constrained_path.hpp"
#include "core/numerics/row_panel.hpp"
#include "core/numerics/row_products.hpp"

namespace bromwich {
namespace {

using Column = RowPanel::Column;

Vector step_lengths(const Trajectory& path) {
  const Index M = path.steps();
  return path.t.tail(M) - path.t.head(M);
}

/// u at the nodes of all steps, M x k each; empty where there is no input.
std::vector<RowMatrix> inputs_at_nodes(const Trajectory& path) {
  std::vector<RowMatrix> u;
  if (path.system.port().u)
    for (const double s : quadrature(path.scheme).nodes) u.push_back(path.system.inputs(path.t, s));
  return u;
}

/// x at the nodes of the steps.
class NodeStates {
 public:
  explicit NodeStates(const Trajectory& path) : path_(path) {
    for (const double s : quadrature(path.scheme).nodes) {
      at_.push_back(reconstruction(path.scheme, s));
      if (path.scheme == StepScheme::exponential) within_.push_back(states_within(path, s));
    }
  }
  /// In `count` steps from `first` on: in `panel`, or in `right`, which contains x at their right ends.
  const RowPanel& load(std::size_t q, Index first, Index count, const RowPanel& right, RowPanel& panel) const {
    if (path_.scheme == StepScheme::euler) return right;
    if (path_.scheme == StepScheme::exponential)
      panel.load(within_[q], first, count);
    else
      panel.load_pairs(path_.x, first, count, at_[q].alpha, at_[q].beta);
    return panel;
  }

 private:
  const Trajectory& path_;
  std::vector<Reconstruction> at_;
  std::vector<RowMatrix> within_;
};

/// Where x is a combination of both ends within each step, x = alpha x_{i-1} + beta x_i, the derivative of
///     Σ_i w_i (H(x_i) - H(x_{i-1}) + h_i Σ_q weights_q (x_q^T D x_q - u_q^T B^T Q x_q)),   D = Q^T R Q,
/// towards x_i is
///     (w_i - w_{i+1}) Q^T E x_i + 2 D (a x_{i-1} + b x_i + c x_{i+1}) - Q^T B Σ_q weights_q (w_i h_i beta u_q +
///     w_{i+1} h_{i+1} alpha u_q'),   u_q' those of the next step,
///     a = w_i h_i <alpha beta>, b = w_i h_i <beta^2> + w_{i+1} h_{i+1} <alpha^2>, c = w_{i+1} h_{i+1} <alpha beta>,
/// <.> being sums over q with the weights; w_0 = w_{M+1} = 0.
RowMatrix linear_balance_gradient(const Trajectory& path, const Vector& w) {
  const PortSystem& system = path.system;
  const Index M = path.steps(), m = path.x.cols();
  const auto& [nodes, weights] = quadrature(path.scheme);
  const std::vector<RowMatrix> u = inputs_at_nodes(path);
  std::vector<Reconstruction> at;
  double alpha_alpha = 0, alpha_beta = 0, beta_beta = 0;
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const Reconstruction& r = at.emplace_back(reconstruction(path.scheme, nodes[q]));
    alpha_alpha += weights[q] * r.alpha * r.alpha;
    alpha_beta += weights[q] * r.alpha * r.beta;
    beta_beta += weights[q] * r.beta * r.beta;
  }
  const bool neighbours = alpha_beta != 0;
  const SparseMatrix inputs = system.output_matrix().transpose();
  RowMatrix gradient(M + 1, m);
  each_panel(path.threads, M + 1, m, [&] {
    return [&, x = RowPanel(m), left = RowPanel(m), right = RowPanel(m), input = RowPanel(system.port().ports()),
            g = RowPanel(m)](Index first, Index count) mutable {
      // Terms of the steps that end and that begin at a row.
      Column ending = Column::Zero(), beginning = ending, ending_h = ending, beginning_h = ending;
      for (Index r = 0; r < count; ++r) {
        const Index i = first + r;
        if (i > 0) ending[r] = w[i - 1], ending_h[r] = w[i - 1] * path.h(i - 1);
        if (i < M) beginning[r] = w[i], beginning_h[r] = w[i] * path.h(i);
      }
      g.set_zero();
      x.load(path.x, first, count);
      const Column of_energy = ending - beginning;
      x.each_product(system.energy_matrix(), [&](Index j, const Column& column) { g.col(j) = of_energy * column; });
      const Column own = 2 * (beta_beta * ending_h + alpha_alpha * beginning_h);
      if (neighbours) {
        left.load(path.x, first - 1, count);
        right.load(path.x, first + 1, count);
        const Column before = 2 * alpha_beta * ending_h, behind = 2 * alpha_beta * beginning_h;
        for (Index j = 0; j < m; ++j) x.col(j) = before * left.col(j) + own * x.col(j) + behind * right.col(j);
        x.each_product(system.dissipation_matrix(), [&](Index j, const Column& column) { g.col(j) += column; });
      } else {
        x.each_product(system.dissipation_matrix(), [&](Index j, const Column& column) { g.col(j) += own * column; });
      }
      for (std::size_t q = 0; q < u.size(); ++q) {
        input.load(u[q], first - 1, count);
        const Column before = weights[q] * at[q].beta * ending_h, behind = weights[q] * at[q].alpha * beginning_h;
        input.each_product(inputs, [&](Index j, const Column& column) { g.col(j) -= before * column; });
        if (at[q].alpha == 0) continue;
        input.load(u[q], first, count);
        input.each_product(inputs, [&](Index j, const Column& column) { g.col(j) -= behind * column; });
      }
      g.store(gradient, first, count);
    };
  });
  return gradient;
}

RowMatrix cubic_balance_gradient(const Trajectory& path, const Vector& w) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  RowMatrix gradient = RowMatrix::Zero(M + 1, path.x.cols());
  Vector of_energy = Vector::Zero(M + 1);  // the energy of a point ends one step and begins the next
  of_energy.tail(M) += w;
  of_energy.head(M) -= w;
  add_row_products(of_energy, path.x, system.energy_matrix(), gradient);  // dH/dx
  const SparseMatrix inputs = system.output_matrix().transpose();
  const std::vector<RowMatrix> u = inputs_at_nodes(path);
  const auto& [nodes, weights] = quadrature(path.scheme);
  for (std::size_t q = 0; q < nodes.size(); ++q) {
    const Vector wh = weights[q] * w.cwiseProduct(step_lengths(path));
    RowMatrix g = RowMatrix::Zero(M, path.x.cols());
    add_row_products(2 * wh, states_within(path, nodes[q]), system.dissipation_matrix(), g);
    if (!u.empty()) add_row_products(-wh, u[q], inputs, g);
    add_within(path, nodes[q], g, gradient);
  }
  return gradient;
}

}  // namespace

EnergyBalance energy_balance(const Trajectory& path) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const Vector h = step_lengths(path);
  EnergyBalance b{Vector(M + 1), Vector::Zero(M), Vector::Zero(M), Vector(M)};
  const auto& [nodes, weights] = quadrature(path.scheme);
  const std::vector<RowMatrix> u = inputs_at_nodes(path);
  const NodeStates states(path);
  b.energy[0] = row_forms(path.x.topRows(1), system.energy_matrix())[0] / 2;
  each_panel(path.threads, M, path.x.cols(), [&] {
    return [&, right = RowPanel(), within = RowPanel(), input = RowPanel()](Index first, Index count) mutable {
      right.load(path.x, first + 1, count);
      b.energy.segment(first + 1, count) = 0.5 * right.form(system.energy_matrix(), right).head(count);
      for (std::size_t q = 0; q < nodes.size(); ++q) {
        const RowPanel& x = states.load(q, first, count, right, within);
        const Column wh = weights[q] * RowPanel::column(h, first, count);
        b.dissipated.segment(first, count) += (wh * x.form(system.dissipation_matrix(), x)).head(count).matrix();
        if (u.empty()) continue;
        input.load(u[q], first, count);
        b.supplied.segment(first, count) += (wh * x.form(system.output_matrix(), input)).head(count).matrix();
      }
    };
  });
  if (path.constraints) b.supplied += constraint_supply(path);
  b.violation = b.dissipated - b.supplied + b.energy.tail(M) - b.energy.head(M);
  return b;
}

PowerBalance power_balance(const Trajectory& path, const RowMatrix& y, const RowMatrix& port_matrix) {
  const PortSystem& system = path.system;
  const Index M = path.steps();
  const RowMatrix& x = path.x;
  PowerBalance p{Vector::Zero(M + 1), row_forms(x, system.dissipation_matrix())};
  if (system.port().u) {
    const RowMatrix outputs = row_products(x, system.output_matrix());
    p.supplied.tail(M) = outputs.bottomRows(M).cwiseProduct(system.inputs(path.t, 1)).rowwise().sum();
    p.supplied[0] = outputs.row(0).dot(system.inputs(path.t.head(2), 0).row(0));
  }
  if (y.size() > 0) p.supplied += (x * port_matrix).cwiseProduct(y).rowwise().sum();
  return p;
}

RowMatrix balance_gradient(const Trajectory& path, const Vector& w) {
  RowMatrix gradient =
      path.scheme == StepScheme::exponential ? cubic_balance_gradient(path, w) : linear_balance_gradient(path, w);
  if (path.constraints) add_constraint_supply(path, -w, gradient);
  return gradient;
}

}  // namespace bromwich
