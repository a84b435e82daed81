#include "core/kernel/recurrence.hpp"

#include "core/base/error.hpp"
#include "core/numerics/equilibration.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"
#include "core/numerics/precise_phi.hpp"
#include "core/numerics/sectorial.hpp"
#include "core/numerics/sine_basis.hpp"

#include <Eigen/LU>

#include <cmath>
#include <optional>

namespace bromwich {

namespace {

// The recurrence of one exponential e^{x/h t} with unit weight, x = h lambda.
struct ScalarRule {
  double decay, output, start, w0;
};

ScalarRule exponential_rule(double x, double h) {
  const double p1 = phi1(x), p2 = phi2(x), decay = std::exp(x);
  // S_d / W_d = (phi1 - phi2)/phi1^2.
  return {decay, h * p1 * p1, (p1 - p2) / (p1 * p1), h * p2};
}

ScalarRule euler_rule(double x, double h) {
  const double decay = 1 / (1 - x);
  return {decay, h * decay * decay, 0, h * decay};
}

}  // namespace

ModalRecurrence modal_recurrence(const KroneckerDynamics& dynamics, Rule rule, double h, const RowMatrix& x0_modal) {
  const Index n = dynamics.face_points(), K = dynamics.across.points;
  const Vector mu = dynamics.face_eigenvalues(), nu = dynamics.across.eigenvalues();
  const Vector seen = dynamics.across.in_modes(dynamics.n);
  const Matrix b = dynamics.inputs_in_modes();
  ModalRecurrence r;
  r.face = dynamics.face_basis();
  r.families = dynamics.families();
  r.decay.resize(K, n);
  r.output.resize(K, n);
  r.start.resize(K, n);
  r.w0 = r.w1 = r.s1 = Vector::Zero(n);
  for (Index k = 0; k < K; ++k) {
    for (Index l = 0; l < n; ++l) {
      const double x = h * (mu[l] + nu[k]);
      const ScalarRule s = rule == Rule::exponential ? exponential_rule(x, h) : euler_rule(x, h);
      r.decay(k, l) = s.decay;
      const double weight = seen[k] * b(k, dynamics.family(l));
      r.output(k, l) = weight * s.output;
      r.start(k, l) = s.start;
      r.w0[l] += weight * s.w0;
    }
  }
  if (x0_modal.size() > 0) r.initial = modal_start(r, dynamics, rule, h, x0_modal);
  return r;
}

RowMatrix modal_start(const ModalRecurrence& r, const KroneckerDynamics& dynamics, Rule rule, double h,
                      const RowMatrix& x0_modal) {
  const Vector mu = dynamics.face_eigenvalues(), nu = dynamics.across.eigenvalues();
  const Matrix b = dynamics.inputs_in_modes();
  if (b.cwiseAbs().minCoeff() <= 1e-12 * b.cwiseAbs().maxCoeff())
    throw Error("dynamics.b",
                "a component of it in the modes of a line is zero, so that mode of x0 is not in the driven recurrence",
                "leave x0 out and add its response");
  RowMatrix initial(r.decay.rows(), r.decay.cols());
  for (Index k = 0; k < nu.size(); ++k)
    for (Index l = 0; l < mu.size(); ++l) {
      const double decay = r.decay(k, l), p1 = rule == Rule::exponential ? phi1(h * (mu[l] + nu[k])) : 1;
      const double unit = rule == Rule::exponential ? decay / (h * p1 * p1) : 1 / (h * decay);
      initial(k, l) = x0_modal(l, k) * unit / b(k, dynamics.family(l));
    }
  return initial;
}

bool needs_precision(const Matrix& A, double h, Index J) {
  constexpr Index largest = 24;  // m^3 products of 25 operations each, about a hundred times
  constexpr double harmless = 1e-9;
  if (A.rows() == 0 || A.rows() > largest || !A.allFinite()) return false;
  return epsilon * h * double(J) * balanced(A).A.cwiseAbs().colwise().sum().maxCoeff() > harmless;
}

namespace {

// (I - hA)^{-1}; empty if it is singular.
std::optional<Matrix> inverse_of_step(const Matrix& A, double h) {
  return regular_inverse(Matrix(Matrix::Identity(A.rows(), A.rows()) - h * A));
}

}  // namespace

bool has_euler_step(const Matrix& A, double h) { return inverse_of_step(A, h).has_value(); }

StepOperators step_operators(const Matrix& A, Rule rule, double h, Index J) {
  const Index m = A.rows();
  if (rule == Rule::exponential)
    return exponential_step(needs_precision(A, h, J) ? precise_phi(A, h) : matrix_phi(h * A), h);
  const std::optional<Matrix> decay = inverse_of_step(A, h);
  if (!decay) throw Error("steps", "I - hA is singular at this step", "implicit Euler needs another number of steps");
  return {*decay, Matrix::Zero(m, m), h * *decay};
}

StepOperators exponential_step(const MatrixPhi& phi, double h) {
  return {phi.exponential, h * (phi.phi1 - phi.phi2), h * phi.phi2};
}

DenseRecurrence dense_recurrence(const DenseDynamics& dynamics, const StepOperators& step) {
  const Matrix right = step.right * dynamics.B, left = step.left * dynamics.B;
  return {step.decay, step.decay * right + left, left, dynamics.N, dynamics.N * right};
}

DenseRecurrence dense_recurrence(const DenseDynamics& dynamics, Rule rule, double h) {
  return dense_recurrence(dynamics, step_operators(dynamics.A, rule, h));
}

namespace {

LagTable table_of(const ModalRecurrence& r, Index J) {
  const Index n = r.modes();
  LagTable table{n, n, true, RowMatrix::Zero(J + 1, n), RowMatrix::Zero(J + 1, n), r.face};
  RowMatrix power = RowMatrix::Ones(r.exponentials(), n);
  table.W.row(0) = r.w0.transpose();
  for (Index d = 1; d <= J; ++d) {
    table.W.row(d) = power.cwiseProduct(r.output).colwise().sum();
    table.S.row(d) = power.cwiseProduct(r.output).cwiseProduct(r.start).colwise().sum();
    power.array() *= r.decay.array();
  }
  if (J >= 1) {
    table.W.row(1) += r.w1.transpose();
    table.S.row(1) += r.s1.transpose();
  }
  return table;
}

LagTable table_of(const DenseRecurrence& r, Index J) {
  const Index n = r.output.rows(), k = r.input.cols();
  LagTable table{n, k, false, RowMatrix::Zero(J + 1, n * k), RowMatrix::Zero(J + 1, n * k), {}};
  Eigen::Map<RowMatrix>(table.W.row(0).data(), n, k) = r.w0;
  Matrix row = r.output;  // C E^{d-1}
  for (Index d = 1; d <= J; ++d) {
    Eigen::Map<RowMatrix>(table.W.row(d).data(), n, k) = row * r.input;
    Eigen::Map<RowMatrix>(table.S.row(d).data(), n, k) = row * r.start;
    row *= r.decay;
  }
  return table;
}

}  // namespace

LagTable lag_table(const Recurrence& recurrence, Index J) {
  return std::visit([J](const auto& r) { return table_of(r, J); }, recurrence);
}

}  // namespace bromwich
