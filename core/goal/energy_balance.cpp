#include "core/goal/energy_balance.hpp"

#include "core/goal/constrained_path.hpp"
#include "core/numerics/row_panel.hpp"
#include "core/numerics/row_products.hpp"

namespace bromwich {
namespace {

using Column = RowPanel::Column;

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
class LinearBalanceGradient {
 public:
  LinearBalanceGradient(const Trajectory& path, const Vector& w)
      : path_(path),
        w_(w),
        weights_(quadrature(path.scheme).weights),
        u_(inputs_at_nodes(path)),
        inputs_(path.system.output_matrix().transpose()) {
    const std::vector<double>& nodes = quadrature(path.scheme).nodes;
    for (std::size_t q = 0; q < nodes.size(); ++q) {
      const Reconstruction& r = at_.emplace_back(reconstruction(path.scheme, nodes[q]));
      alpha_alpha_ += weights_[q] * r.alpha * r.alpha;
      alpha_beta_ += weights_[q] * r.alpha * r.beta;
      beta_beta_ += weights_[q] * r.beta * r.beta;
    }
  }

  RowMatrix operator()() const {
    const Index rows = path_.steps() + 1, m = path_.x.cols();
    RowMatrix gradient(rows, m);
    each_panel(path_.threads, rows, m, [&] {
      return [&, x = RowPanel(m), g = RowPanel(m), left = RowPanel(m), right = RowPanel(m),
              input = RowPanel(path_.system.port().ports())](Index first, Index count) mutable {
        const StepWeights of = weights_of_rows(first, count);
        x.load(path_.x, first, count);
        g.set_zero();
        add_energy(of, x, g);
        if (alpha_beta_ != 0) {
          left.load(path_.x, first - 1, count);
          right.load(path_.x, first + 1, count);
        }
        add_dissipation(of, left, x, right, g);
        subtract_inputs(of, first, count, input, g);
        g.store(gradient, first, count);
      };
    });
    return gradient;
  }

 private:
  /// w and w h of the steps that end and that begin at the rows of a panel.
  struct StepWeights {
    Column ending = Column::Zero(), beginning = ending, ending_h = ending, beginning_h = ending;
  };

  StepWeights weights_of_rows(Index first, Index count) const {
    StepWeights of;
    for (Index r = 0; r < count; ++r) {
      const Index i = first + r;
      if (i > 0) of.ending[r] = w_[i - 1], of.ending_h[r] = w_[i - 1] * path_.h(i - 1);
      if (i < path_.steps()) of.beginning[r] = w_[i], of.beginning_h[r] = w_[i] * path_.h(i);
    }
    return of;
  }

  void add_energy(const StepWeights& of, const RowPanel& x, RowPanel& g) const {
    const Column change = of.ending - of.beginning;
    x.each_product(path_.system.energy_matrix(), [&](Index j, const Column& column) { g.col(j) = change * column; });
  }

  /// x is used up. Where alpha beta = 0 no neighbours take part, and D comes first.
  void add_dissipation(const StepWeights& of, const RowPanel& left, RowPanel& x, const RowPanel& right,
                       RowPanel& g) const {
    const SparseMatrix& D = path_.system.dissipation_matrix();
    const Column own = 2 * (beta_beta_ * of.ending_h + alpha_alpha_ * of.beginning_h);
    if (alpha_beta_ == 0) {
      x.each_product(D, [&](Index j, const Column& column) { g.col(j) += own * column; });
      return;
    }
    const Column before = 2 * alpha_beta_ * of.ending_h, behind = 2 * alpha_beta_ * of.beginning_h;
    for (Index j = 0; j < path_.x.cols(); ++j) x.col(j) = before * left.col(j) + own * x.col(j) + behind * right.col(j);
    x.each_product(D, [&](Index j, const Column& column) { g.col(j) += column; });
  }

  void subtract_inputs(const StepWeights& of, Index first, Index count, RowPanel& input, RowPanel& g) const {
    for (std::size_t q = 0; q < u_.size(); ++q) {
      input.load(u_[q], first - 1, count);
      const Column before = weights_[q] * at_[q].beta * of.ending_h,
                   behind = weights_[q] * at_[q].alpha * of.beginning_h;
      input.each_product(inputs_, [&](Index j, const Column& column) { g.col(j) -= before * column; });
      if (at_[q].alpha == 0) continue;
      input.load(u_[q], first, count);
      input.each_product(inputs_, [&](Index j, const Column& column) { g.col(j) -= behind * column; });
    }
  }

  const Trajectory& path_;
  const Vector& w_;
  const std::vector<double>& weights_;
  std::vector<RowMatrix> u_;
  SparseMatrix inputs_;  ///< B^T Q
  std::vector<Reconstruction> at_;
  double alpha_alpha_ = 0, alpha_beta_ = 0, beta_beta_ = 0;  ///< <.> over the nodes
};

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
    const Vector wh = weights[q] * w.cwiseProduct(path.lengths());
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
  const Vector h = path.lengths();
  EnergyBalance b{Vector(M + 1), Vector::Zero(M), Vector::Zero(M), Vector(M)};
  const std::vector<double>& weights = quadrature(path.scheme).weights;
  const std::vector<RowMatrix> u = inputs_at_nodes(path);
  const NodeStates states(path);
  b.energy[0] = row_forms(path.x.topRows(1), system.energy_matrix())[0] / 2;
  each_panel(path.threads, M, path.x.cols(), [&] {
    return [&, right = RowPanel(), within = RowPanel(), input = RowPanel()](Index first, Index count) mutable {
      right.load(path.x, first + 1, count);
      b.energy.segment(first + 1, count) = 0.5 * right.form(system.energy_matrix(), right).head(count);
      for (std::size_t q = 0; q < weights.size(); ++q) {
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
      path.scheme == StepScheme::exponential ? cubic_balance_gradient(path, w) : LinearBalanceGradient(path, w)();
  if (path.constraints) add_constraint_supply(path, -w, gradient);
  return gradient;
}

}  // namespace bromwich
