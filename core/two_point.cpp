#include "core/two_point.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

namespace bromwich {

Segment step_segment(const Matrix& P, const Vector& p) { return {-P, Matrix::Identity(P.rows(), P.rows()), p}; }

Segment joined(const Segment& first, const Segment& second, InnerState* inner) {
  const Index m = first.r.size();
  Matrix shared(2 * m, m), rest = Matrix::Zero(2 * m, 2 * m + 1);
  shared << first.U, second.V;
  rest.topLeftCorner(m, m) = first.V;
  rest.block(m, m, m, m) = second.U;
  rest.col(2 * m) << first.r, second.r;
  const Eigen::HouseholderQR<Matrix> qr(shared);
  rest.applyOnTheLeft(qr.householderQ().adjoint());
  if (inner) {
    const Matrix x = qr.matrixQR().topRows(m).template triangularView<Eigen::Upper>().solve(Matrix(rest.topRows(m)));
    *inner = {-x.leftCols(m), -x.middleCols(m, m), x.col(2 * m)};
  }
  return {rest.bottomLeftCorner(m, m), rest.block(m, m, m, m), rest.bottomRightCorner(m, 1)};
}

Segment repeated(const Matrix& P, const Vector& p, Index N) {
  Segment power = step_segment(P, p);
  Segment all;
  bool any = false;
  for (;; N /= 2) {
    if (N % 2 == 1) {
      all = any ? joined(power, all) : power;
      any = true;
    }
    if (N <= 1) return all;
    power = joined(power, power);
  }
}

EndStates solve_ends(const Segment& all, const BoundaryCondition& boundary) {
  const Index m = all.r.size();
  Matrix system(2 * m, 2 * m);
  system << all.V, all.U, boundary.E0, boundary.ET;
  if (!system.allFinite()) return {Vector::Constant(m, NAN), Vector::Constant(m, NAN), 0};
  const Equilibration scale = equilibrate(system);
  const Matrix balanced = scale.rows.asDiagonal() * system * scale.columns.asDiagonal();
  const Eigen::PartialPivLU<Matrix> lu(balanced);
  Vector right(2 * m);
  right << all.r, boundary.b;
  const Vector ends = scale.columns.cwiseProduct(lu.solve(scale.rows.cwiseProduct(right)));
  return {ends.head(m), ends.tail(m), reciprocal_condition(lu)};
}

RowMatrix solve_two_point(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition& boundary,
                          double least_condition) {
  const Index N = p.rows(), m = p.cols();
  std::vector<InnerState> inner(std::size_t(N - 1));
  Segment all = step_segment(*P[0], p.row(0));
  for (Index k = 1; k < N; ++k)
    all = joined(all, step_segment(*P[std::size_t(k)], p.row(k)), &inner[std::size_t(k - 1)]);
  const EndStates ends = solve_ends(all, boundary);
  if (!(ends.reciprocal_condition >= least_condition)) return RowMatrix(0, m);
  RowMatrix x(N + 1, m);
  x.row(0) = ends.first.transpose();
  x.row(N) = ends.last.transpose();
  Vector next = ends.last;
  for (Index k = N - 1; k > 0; --k) {
    const InnerState& s = inner[std::size_t(k - 1)];
    next = (s.a + s.L * ends.first + s.R * next).eval();
    x.row(k) = next.transpose();
  }
  return x;
}

}  // namespace bromwich
