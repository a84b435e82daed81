#include "core/response.hpp"

#include "core/discrete_problem.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

Vector time_grid(double T, Index J) {
  Vector t(J + 1);
  for (Index j = 0; j <= J; ++j) t[j] = T * double(j) / double(J);
  return t;
}

namespace {

// One period of the entries of S as a table: i k is reduced exactly, whatever its size.
Vector sine_period(Index n) {
  Vector period(2 * (n + 1));
  for (Index a = 0; a < period.size(); ++a)
    period[a] = std::sqrt(2.0 / double(n + 1)) * std::sin(std::numbers::pi * double(a) / double(n + 1));
  return period;
}

}  // namespace

Vector in_sine_basis(const Vector& v) {
  const Vector period = sine_period(v.size());
  Vector modes = Vector::Zero(v.size());
  for (Index i = 0; i < v.size(); ++i)
    for (Index k = 0; v[i] != 0 && k < v.size(); ++k) modes[k] += v[i] * period[(i + 1) * (k + 1) % period.size()];
  return modes;
}

Matrix sine_matrix(Index n) {
  const Vector period = sine_period(n);
  Matrix S(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k < n; ++k) S(k, i) = period[(i + 1) * (k + 1) % period.size()];
  return S;
}

RowMatrix row_modes(Backend& backend, const RowMatrix& rows) {
  const auto in = backend.array(rows.rows(), rows.cols()), out = backend.array(rows.rows(), rows.cols());
  backend.upload(rows, *in);
  backend.sine_transform(rows.cols(), rows.rows())->apply(*in, nullptr, *out, 0);
  RowMatrix modes;
  backend.download(*out, modes);
  return modes;
}

RowMatrix x0_in_modes(Backend& backend, const KroneckerDynamics& d, const Vector& x0, bool both) {
  // S acts on rows: the transpose for the `along` direction.
  const Eigen::Map<const RowMatrix> lines(x0.data(), d.along.points, d.across.points);
  const RowMatrix modes = row_modes(backend, lines.transpose()).transpose();
  return both ? row_modes(backend, modes) : modes;
}

RowMatrix dense_states(const StepOperators& step, const Vector& x0, const RowMatrix& u, const StepDefects* defects) {
  // Time-major products first, so that the sequential part is one small matrix-vector product a step.
  RowMatrix x = u * step.right.transpose();
  x.bottomRows(x.rows() - 1) += u.topRows(u.rows() - 1) * step.left.transpose();
  if (defects) defects->add_to(x);
  x.row(0) = x0.transpose();
  for (Index j = 1; j < x.rows(); ++j) x.row(j).transpose().noalias() += step.decay * x.row(j - 1).transpose();
  return x;
}

RowMatrix dense_states(const Matrix& A, Rule rule, double h, const Vector& x0, const RowMatrix& u) {
  return dense_states(step_operators(A, rule, h), x0, u);
}

}  // namespace bromwich
