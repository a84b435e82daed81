#include "circuits/operating_point.hpp"

#include "core/lcp/active_set.hpp"

#include <Eigen/SparseLU>

namespace bromwich::circuits {

std::optional<Vector> operating_point(const SparseMatrix& A, const SparseMatrix& B, const Vector& b,
                                      const SparseMatrix& N, const SparseMatrix& M, const Vector& q, double T) {
  constexpr int steps = 60;
  constexpr double rest = 1e-11, growth = 8;
  const Index m = A.rows();
  Vector x = Vector::Zero(m), y = Vector::Zero(M.rows());
  if (m == 0) return x;
  double h = T / 64;
  SparseMatrix unit(m, m);
  unit.setIdentity();
  for (int k = 0; k < steps; ++k, h *= growth) {
    const SparseMatrix step_matrix = unit - h * A;
    Eigen::SparseLU<SparseMatrix> lu(step_matrix);
    if (lu.info() != Eigen::Success) return std::nullopt;
    const Vector free = lu.solve(Vector(x + h * b));
    Vector next = free;
    if (M.rows() > 0) {
      const Matrix response = h * Matrix(lu.solve(Matrix(B))), step = Matrix(M) + N * response;
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
