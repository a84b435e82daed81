#include "core/numerics/sine_basis.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

// One period of the entries of S as a table: i k is reduced exactly for any size.
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

Matrix face_sine_matrix(const std::vector<Index>& extents) {
  Matrix S = Matrix::Ones(1, 1);
  for (const Index n : extents) {
    const Matrix outer = S, inner = sine_matrix(n);
    S.resize(outer.rows() * n, outer.cols() * n);
    for (Index i = 0; i < outer.rows(); ++i)
      for (Index j = 0; j < outer.cols(); ++j) S.block(i * n, j * n, n, n) = outer(i, j) * inner;
  }
  return S;
}

void to_face_modes(const std::vector<Index>& extents, double* values) {
  Index outer = 1, inner = 1;
  for (const Index n : extents) inner *= n;
  for (const Index n : extents) {
    const Matrix S = sine_matrix(n);
    inner /= n;
    for (Index i = 0; i < outer; ++i) {
      Eigen::Map<RowMatrix> block(values + i * n * inner, n, inner);
      block = (S * block).eval();
    }
    outer *= n;
  }
}

}  // namespace bromwich
