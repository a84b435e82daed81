#include "core/events/short_steps.hpp"

#include "core/lcp/active_set.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

ShortSteps::ShortSteps(const SystemMatrices& system, const EventSources& sources, double T)
    : system_(system), sources_(sources), rate_(std::max(1 / T, system.A.cwiseAbs().rowwise().sum().maxCoeff())) {}

bool ShortSteps::unique(LcpClass lcp_class) {
  class_ = LcpClass::P;
  if (system_.constraints() == 0 || has_one_solution(lcp_class)) return true;
  if (!is_PSD(LcpMatrix(system_.M))) return false;
  for (const double share : {1e-2, 1e-5}) {
    const Matrix moved = response(share / rate_);
    if (has_one_solution(classify(LcpMatrix(Matrix(system_.M + moved))))) continue;
    // The parts of M and of the response by themselves: that of a skew M is zero, and rounding of M does not count.
    if (!is_monotone(Matrix(system_.M + system_.M.transpose()) + Matrix(moved + moved.transpose()))) return false;
    class_ = LcpClass::PSD;
  }
  return true;
}

// h N (I - hA)^{-1} B: what y adds to w within a step.
Matrix ShortSteps::response(double h) const {
  const Matrix shifted = Matrix::Identity(system_.states(), system_.states()) - h * system_.A;
  return h * (system_.N * shifted.partialPivLu().solve(system_.B));
}

// Whether the problem of a step, with twice the symmetric part S of its matrix, is monotone and determines B y: the
// difference of two solutions lies in the null space of S.
bool ShortSteps::is_monotone(const Matrix& S) const {
  const Index n = system_.constraints();
  const Vector by = S.diagonal().cwiseAbs().cwiseMax(1e-290).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(Matrix(by.asDiagonal() * S * by.asDiagonal()));
  const Matrix B = system_.B * by.asDiagonal();
  const double zero = 1e-9 * solver.eigenvalues()[n - 1];
  if (!(solver.eigenvalues()[0] >= -zero)) return false;
  for (Index k = 0; k < n; ++k)
    if (solver.eigenvalues()[k] < zero &&
        (B * solver.eigenvectors().col(k)).cwiseAbs().maxCoeff() > 1e-7 * B.cwiseAbs().maxCoeff())
      return false;
  return true;
}

ShortSteps::Step ShortSteps::take(double t, double h, const Vector& x, const Vector& offset) const {
  const Index m = system_.states();
  const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(m, m) - h * system_.A);
  const Matrix moved = h * lu.solve(system_.B);
  const Vector free = lu.solve(x + h * sources_.f(t + h));
  const Vector q = system_.N * free + sources_.g(t + h) - offset;
  Step step;
  ActiveSetLcp lcp(system_.M + system_.N * moved, class_);
  step.solved = lcp.solve(q, step.y).solved;
  if (step.solved) step.x = free + moved * step.y;
  return step;
}

}  // namespace bromwich
