#include "core/numerics/equilibration.hpp"

#include <cmath>

namespace bromwich {

void divide_by_roots(const Vector& largest, Vector& factors) {
  for (Index i = 0; i < factors.size(); ++i)
    if (largest[i] > 0) factors[i] *= 1 / std::sqrt(largest[i]);
}

void round_to_powers_of_two(Vector& factors) {
  for (double& s : factors) s = std::exp2(std::round(std::log2(s)));
}

Equilibration equilibrate(const Matrix& A) {
  return equilibrate(A.rows(), A.cols(), [&A](const Equilibration& e, Vector& rows, Vector& columns) {
    rows = Vector::Zero(A.rows());
    columns.resize(A.cols());
    Vector scaled(A.rows());
    for (Index k = 0; k < A.cols(); ++k) {  // columns are contiguous
      scaled = e.rows.cwiseProduct(A.col(k).cwiseAbs()) * e.columns[k];
      columns[k] = scaled.maxCoeff();
      rows = rows.cwiseMax(scaled);
    }
  });
}

Matrix scaled(const Matrix& A, const Equilibration& e) { return e.rows.asDiagonal() * A * e.columns.asDiagonal(); }

std::optional<Matrix> scaled_inverse(const Matrix& A, double least_condition) {
  const Vector rows = A.cwiseAbs().rowwise().maxCoeff();
  if (!(rows.minCoeff() > 0)) return std::nullopt;
  const Matrix by_rows = rows.cwiseInverse().asDiagonal() * A;
  const Vector columns = by_rows.cwiseAbs().colwise().maxCoeff().transpose();
  if (!(columns.minCoeff() > 0)) return std::nullopt;
  const Eigen::PartialPivLU<Matrix> lu(by_rows * columns.cwiseInverse().asDiagonal());
  if (!(reciprocal_condition(lu) > least_condition)) return std::nullopt;
  return Matrix(columns.cwiseInverse().asDiagonal() * lu.inverse() * rows.cwiseInverse().asDiagonal());
}

double reciprocal_condition(const Eigen::PartialPivLU<Matrix>& lu) {
  const Vector pivots = lu.matrixLU().diagonal().cwiseAbs();
  for (const double p : pivots)
    if (!(p > 0) || !std::isfinite(p)) return 0;
  return lu.rcond();
}

}  // namespace bromwich
