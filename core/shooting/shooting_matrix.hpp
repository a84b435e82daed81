#pragma once
// E0 + ET D of Newton's method on x(0), with rows and columns in comparable sizes.

#include "../scene/scene.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

struct ShootingMatrix {
  /// Of its terms: singular values beside which rounding of the flow, 1e-13, leaves a part of x(0) open.
  static constexpr double singular_share = 1e-10;

  Eigen::JacobiSVD<Matrix> svd;
  Vector rows, columns;
  bool regular;

  /// `size`: of the states.
  ShootingMatrix(const BoundaryCondition& c, const Matrix& D, const Vector& size)
      : rows(Vector::Ones(size.size())), columns(size) {
    Matrix K = (c.E0 + c.ET * D) * columns.asDiagonal();
    for (Index i = 0; i < K.rows(); ++i) {
      const double terms = (c.E0.row(i).cwiseAbs() + c.ET.row(i).cwiseAbs()).dot(size);
      if (terms > 0) rows[i] = 1 / terms;
    }
    svd.compute(rows.asDiagonal() * K, Eigen::ComputeThinU | Eigen::ComputeThinV);
    const Vector& values = svd.singularValues();
    svd.setThreshold(values[0] > singular_share ? singular_share / values[0] : 2.0);  // 2: the rank is 0
    regular = svd.rank() == size.size();
  }
  /// Of periodic conditions, E0 = -ET: what each period adds to a state that drifts, u with (E0 + ET D) u = 0 and F -
  /// E0 u in the range of E0 + ET D.
  Vector drift(const BoundaryCondition& c, const Vector& F) const {
    const Index open = columns.size() - svd.rank();
    if (open == 0) return Vector::Zero(columns.size());
    const Matrix V = columns.asDiagonal() * svd.matrixV().rightCols(open),
                 W = rows.asDiagonal() * svd.matrixU().rightCols(open);
    return V * (W.transpose() * c.E0 * V).fullPivLu().solve(W.transpose() * F);
  }
  /// dx of least norm.
  Vector solve(const Vector& F) const { return columns.asDiagonal() * svd.solve(rows.asDiagonal() * F); }
};

}  // namespace bromwich
