#include "derivatives/step_direction.hpp"

#include "core/kernel/recurrence.hpp"

#include <algorithm>

namespace bromwich {

StepDirection step_direction(const Matrix& A, const Matrix& D, double h) {
  const Index m = A.rows();
  const double size = D.cwiseAbs().maxCoeff();
  if (!(size > 0)) return {Matrix::Zero(m, m), Matrix::Zero(m, m), Matrix::Zero(m, m)};
  const double unit = std::max(A.cwiseAbs().maxCoeff(), 1e-3 / h) / size;
  Matrix both = Matrix::Zero(2 * m, 2 * m);
  both.topLeftCorner(m, m) = both.bottomRightCorner(m, m) = A;
  both.topRightCorner(m, m) = unit * D;
  const StepOperators step = step_operators(both, Rule::exponential, h);
  const auto block = [&](const Matrix& whole) { return Matrix(whole.topRightCorner(m, m) / unit); };
  return {block(step.decay), block(step.left), block(step.right)};
}

StepDirections::StepDirections(const Matrix& A, double h) : m_(A.rows()), map_(3 * m_ * m_, m_ * m_) {
  for (Index i = 0; i < m_; ++i)
    for (Index k = 0; k < m_; ++k) {
      Matrix D = Matrix::Zero(m_, m_);
      D(i, k) = 1;
      const StepDirection d = step_direction(A, D, h);
      Vector column(3 * m_ * m_);
      Index first = 0;
      for (const Matrix* part : {&d.decay, &d.left, &d.right}) {
        Eigen::Map<RowMatrix>(column.data() + first, m_, m_) = *part;
        first += m_ * m_;
      }
      map_.col(i * m_ + k) = column;
    }
}

void StepDirections::forward(const Matrix& D, double* changes) const {
  const RowMatrix by_rows = D;
  Eigen::Map<Vector>(changes, map_.rows()).noalias() = map_ * Eigen::Map<const Vector>(by_rows.data(), map_.cols());
}

Matrix StepDirections::backward(const double* sums) const {
  const Vector of_A = map_.transpose() * Eigen::Map<const Vector>(sums, map_.rows());
  return Eigen::Map<const RowMatrix>(of_A.data(), m_, m_);
}

}  // namespace bromwich
