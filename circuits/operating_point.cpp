#include "circuits/operating_point.hpp"

#include "core/lcp/active_set.hpp"

#include <Eigen/LU>

namespace bromwich::circuits {

std::optional<Vector> operating_point(const Matrix& A, const Matrix& B, const Vector& b, const Matrix& N,
                                      const Matrix& M, const Vector& q, double T) {
  constexpr int steps = 60;
  constexpr double rest = 1e-11, growth = 8;
  const Index m = A.rows();
  Vector x = Vector::Zero(m), y = Vector::Zero(M.rows());
  double h = T / 64;
  for (int k = 0; k < steps; ++k, h *= growth) {
    const Eigen::FullPivLU<Matrix> lu(Matrix::Identity(m, m) - h * A);
    if (!lu.isInvertible()) return std::nullopt;
    const Vector free = lu.solve(Vector(x + h * b));
    Vector next = free;
    if (M.rows() > 0) {
      const Matrix response = h * lu.solve(B), step = M + N * response;
      ActiveSetLcp problem(step, selection_class(LcpMatrix(step), LcpClass::automatic));
      if (!problem.solve(N * free + q, y).solved) return std::nullopt;
      next += response * y;
    }
    if (!next.allFinite()) return std::nullopt;
    const bool still = (next - x).cwiseAbs().maxCoeff() <= rest * next.cwiseAbs().maxCoeff();
    x = next;
    if (still && h > 1e3 * T) return x;
    if (h > 1e12 * T) break;
  }
  return std::nullopt;
}

}  // namespace bromwich::circuits
