#pragma once
// Transforms between the points and the modes of a face by sums over all points of a line, direction after direction.

#include "core/numerics/face_basis.hpp"

#include <cmath>
#include <numbers>
#include <vector>

namespace bromwich {

class FaceOracle {
 public:
  FaceOracle(const FaceBasis& basis, Way way) {
    for (const LineBasis& line : basis.directions()) {
      const Matrix V = line.V ? *line.V : sines(line.points);
      directions_.push_back(way == Way::to_modes ? Matrix(V.transpose()) : V);
    }
  }

  Vector operator()(Vector v) const {
    Index stride = v.size();
    for (const Matrix& P : directions_) {
      stride /= P.rows();
      Vector next = Vector::Zero(v.size());
      for (Index i = 0; i < v.size(); ++i) {
        const Index at = i / stride % P.rows();
        for (Index k = 0; k < P.rows(); ++k) next[i] += P(at, k) * v[i + (k - at) * stride];
      }
      v = next;
    }
    return v;
  }
  /// The Kronecker product over the directions, entry by entry.
  Matrix matrix() const {
    Matrix all = Matrix::Ones(1, 1);
    for (const Matrix& P : directions_) {
      const Index n = P.rows();
      const Matrix outer = all;
      all.resize(outer.rows() * n, outer.cols() * n);
      for (Index j = 0; j < all.cols(); ++j)
        for (Index i = 0; i < all.rows(); ++i) all(i, j) = outer(i / n, j / n) * P(i % n, j % n);
    }
    return all;
  }

 private:
  static Matrix sines(Index n) {
    const auto entry = [n](Index i, Index k) {
      const double angle = std::numbers::pi * double((i + 1) * (k + 1) % (2 * (n + 1))) / double(n + 1);
      return std::sqrt(2 / double(n + 1)) * std::sin(angle);
    };
    return Matrix::NullaryExpr(n, n, entry);
  }

  std::vector<Matrix> directions_;
};

}  // namespace bromwich
