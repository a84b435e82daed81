#include "core/goal/quantities.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

#include <cmath>

namespace bromwich {
namespace {

/// Σ over the steps of a cell.
Vector per_cell(const Trajectory& path, const Vector& of_steps) {
  Vector sums = Vector::Zero(path.cells());
  for (Index part = 0; part < path.per_cell; ++part) sums += of_steps(Eigen::seqN(part, path.cells(), path.per_cell));
  return sums;
}
/// For each step the value of its cell.
Vector per_step(const Trajectory& path, const Vector& of_cells) {
  Vector values(path.steps());
  for (Index part = 0; part < path.per_cell; ++part) values(Eigen::seqN(part, path.cells(), path.per_cell)) = of_cells;
  return values;
}

/// Rounding of the violations of the cells, which are differences of energies.
Vector balance_rounding(const Trajectory& path, const EnergyBalance& b) {
  const Index M = path.steps();
  const Vector terms = b.energy.head(M) + b.energy.tail(M) + b.supplied.cwiseAbs() + b.dissipated;
  return per_cell(path, 4 * epsilon * terms);
}

/// A functional of the violations of the cells.
class BalanceQuantity : public QuantityOfInterest {
 public:
  double value(const Trajectory& path) const override { return evaluate(path, false).value; }
  double rounding(const Trajectory& path) const override { return evaluate(path, false).rounding; }
  RowMatrix gradient(const Trajectory& path) const override { return evaluate(path, true).gradient; }
  QuantityEvaluation evaluate(const Trajectory& path, bool with_gradient) const override {
    const EnergyBalance balance = energy_balance(path);
    const Vector v = per_cell(path, balance.violation);
    QuantityEvaluation e{of_cells(v), of_cells(balance_rounding(path, balance)), {}};
    if (with_gradient) e.gradient = balance_gradient(path, per_step(path, slope(v)));
    return e;
  }
  std::optional<double> exact() const override { return 0.; }
  double secant() const override { return 0.5; }

 protected:
  virtual double of_cells(const Vector& v) const = 0;
  virtual Vector slope(const Vector& v) const = 0;  ///< its derivative
};

class GlobalBalance : public BalanceQuantity {
 public:
  std::string name() const override { return "glob"; }

 private:
  double of_cells(const Vector& v) const override { return std::pow(v.sum(), 2); }
  Vector slope(const Vector& v) const override { return Vector::Constant(v.size(), 2 * v.sum()); }
};

class LocalBalance : public BalanceQuantity {
 public:
  std::string name() const override { return "loc"; }
  int order(int p) const override { return 2 * p + 1; }  // v decreases by 2^-(p+1), and v^2 is summed over two cells

 private:
  double of_cells(const Vector& v) const override { return v.squaredNorm(); }
  Vector slope(const Vector& v) const override { return 2 * v; }
};

class WeightedBalance : public LocalBalance {
 public:
  explicit WeightedBalance(double rho) : rho_(rho) {
    if (!(rho >= 0) || !std::isfinite(rho)) throw Error("rho", text("found %g", rho), "give a number from 0 on");
  }
  std::string name() const override { return text("loc+%g", rho_); }
  QuantityEvaluation evaluate(const Trajectory& path, bool with_gradient) const override {
    QuantityEvaluation e = LocalBalance::evaluate(path, with_gradient);
    const Vector h = path.lengths();
    const auto& [nodes, weights] = quadrature(path.scheme);
    for (std::size_t q = 0; q < nodes.size(); ++q) {
      const RowMatrix x = states_within(path, nodes[q]);
      e.value += rho_ * weights[q] * h.dot(x.rowwise().squaredNorm());
      if (with_gradient) add_within(path, nodes[q], (2 * rho_ * weights[q] * h).asDiagonal() * x, e.gradient);
    }
    return e;
  }
  std::optional<double> exact() const override { return std::nullopt; }
  double secant() const override { return 1; }
  int order(int p) const override { return p; }

 private:
  double rho_;
};

class User : public QuantityOfInterest {
 public:
  explicit User(UserQuantity q) : q_(std::move(q)) {
    if (!q_.density && !q_.end)
      throw Error("quantity", "has neither an integral nor an end value", "give one of them or both");
    if (bool(q_.density) != bool(q_.density_gradient) || bool(q_.end) != bool(q_.end_gradient))
      throw Error("quantity", "has a function without its gradient", "give both");
  }
  std::string name() const override { return q_.name; }
  double value(const Trajectory& path) const override {
    double sum = 0;
    each_node(path, [&](double t, double weight, const Vector& x, Index) { sum += weight * q_.density(t, x); });
    return q_.end ? sum + q_.end(path.t[path.steps()], path.x.row(path.steps()).transpose()) : sum;
  }
  Vector integrals(const Trajectory& path) const override {
    if (!q_.density) return {};
    Vector of_steps = Vector::Zero(path.steps());
    each_node(path,
              [&](double t, double weight, const Vector& x, Index i) { of_steps[i] += weight * q_.density(t, x); });
    return per_cell(path, of_steps);
  }
  std::vector<double> breakpoints() const override { return q_.breakpoints; }
  RowMatrix gradient(const Trajectory& path) const override {
    RowMatrix gradient = RowMatrix::Zero(path.steps() + 1, path.x.cols()), g(path.steps(), path.x.cols());
    each_node(
        path,
        [&](double t, double weight, const Vector& x, Index i) {
          g.row(i) = weight * q_.density_gradient(t, x).transpose();
        },
        [&](double s) { add_within(path, s, g, gradient); });
    if (q_.end)
      gradient.row(path.steps()) += q_.end_gradient(path.t[path.steps()], path.x.row(path.steps()).transpose());
    return gradient;
  }
  std::optional<double> exact() const override { return q_.exact; }

 private:
  template <typename Visit>
  void each_node(const Trajectory& path, const Visit& visit, const std::function<void(double)>& after = {}) const {
    if (!q_.density) return;
    const auto& [nodes, weights] = quadrature(path.scheme);
    for (std::size_t q = 0; q < nodes.size(); ++q) {
      const RowMatrix x = states_within(path, nodes[q]);
      for (Index i = 0; i < path.steps(); ++i)
        visit(path.t[i] + nodes[q] * path.h(i), weights[q] * path.h(i), x.row(i).transpose(), i);
      if (after) after(nodes[q]);
    }
  }
  UserQuantity q_;
};

}  // namespace

QuantityEvaluation QuantityOfInterest::evaluate(const Trajectory& path, bool with_gradient) const {
  return {value(path), rounding(path), with_gradient ? gradient(path) : RowMatrix()};
}

std::shared_ptr<const QuantityOfInterest> global_balance() { return std::make_shared<GlobalBalance>(); }
std::shared_ptr<const QuantityOfInterest> local_balance() { return std::make_shared<LocalBalance>(); }
std::shared_ptr<const QuantityOfInterest> weighted_balance(double rho) {
  return std::make_shared<WeightedBalance>(rho);
}
std::shared_ptr<const QuantityOfInterest> user_quantity(UserQuantity q) { return std::make_shared<User>(std::move(q)); }

std::shared_ptr<const QuantityOfInterest> quadratic_quantity(const QuadraticQuantity& q, Index states) {
  for (const auto& [member, matrix] : {std::pair("W", &q.W), std::pair("end_W", &q.end_W)})
    if (matrix->size() > 0 && (matrix->rows() != states || matrix->cols() != states))
      throw Error(member, text("is %td x %td", matrix->rows(), matrix->cols()),
                  text("give %td x %td, as there are states", states, states));
  if (q.end_c.size() > 0 && q.end_c.size() != states)
    throw Error("end_c", text("has %td entries", q.end_c.size()), text("give %td, one per state", states));
  // Zeros for omitted members.
  const auto square = [](const SparseMatrix& W, const Vector& x) { return W.size() > 0 ? x.dot(W * x) : 0; };
  const auto slope = [](const SparseMatrix& W, const Vector& x) {
    return W.size() > 0 ? Vector(W * x + W.transpose() * x) : Vector(Vector::Zero(x.size()));
  };
  const auto c = [states, c = q.c](double t) {
    Vector value = Vector::Zero(states);
    if (c) c(t, value);
    return value;
  };
  UserQuantity user{q.name, {}, {}, {}, {}, q.breakpoints, q.exact};
  if (q.W.size() > 0 || q.c) {
    user.density = [=, W = q.W](double t, const Vector& x) { return square(W, x) + c(t).dot(x); };
    user.density_gradient = [=, W = q.W](double t, const Vector& x) { return Vector(slope(W, x) + c(t)); };
  }
  if (q.end_W.size() > 0 || q.end_c.size() > 0) {
    const Vector end_c = q.end_c.size() > 0 ? q.end_c : Vector(Vector::Zero(states));
    user.end = [=, W = q.end_W](double, const Vector& x) { return square(W, x) + end_c.dot(x); };
    user.end_gradient = [=, W = q.end_W](double, const Vector& x) { return Vector(slope(W, x) + end_c); };
  }
  return user_quantity(std::move(user));
}

}  // namespace bromwich
