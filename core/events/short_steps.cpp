#include "core/events/short_steps.hpp"

#include "core/lcp/active_set.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

ShortSteps::ShortSteps(const SystemMatrices& system, const EventSources& sources, double T)
    : system_(system), sources_(sources), rate_(std::max(1 / T, system.A.cwiseAbs().rowwise().sum().maxCoeff())) {}

bool ShortSteps::unique(LcpClass lcp_class) {
  class_ = LcpClass::P;
  if (system_.constraints() == 0 || lcp_class == LcpClass::P) return true;
  if (!is_PSD(LcpMatrix(system_.M))) return false;
  for (const double share : {1e-2, 1e-5}) {
    const Matrix W = step_matrix(share / rate_);
    if (classify(LcpMatrix(W)) == LcpClass::P) continue;
    if (!is_PSD(LcpMatrix(W)) || moves_the_state(W)) return false;
    class_ = LcpClass::PSD;
  }
  return true;
}

// M + h N (I - hA)^{-1} B.
Matrix ShortSteps::step_matrix(double h) const {
  const Matrix shifted = Matrix::Identity(system_.states(), system_.states()) - h * system_.A;
  return system_.M + h * (system_.N * shifted.partialPivLu().solve(system_.B));
}

// Whether two solutions of a monotone problem with the matrix W may have different B y: their difference lies in the
// null space of W + W^T.
bool ShortSteps::moves_the_state(const Matrix& W) const {
  const Index n = system_.constraints();
  const Vector by = W.diagonal().cwiseAbs().cwiseMax(1e-290).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(by.asDiagonal() * Matrix(W + W.transpose()) * by.asDiagonal());
  const Matrix B = system_.B * by.asDiagonal();
  for (Index k = 0; k < n; ++k)
    if (solver.eigenvalues()[k] < 1e-9 * solver.eigenvalues()[n - 1] &&
        (B * solver.eigenvectors().col(k)).cwiseAbs().maxCoeff() > 1e-7 * B.cwiseAbs().maxCoeff())
      return true;
  return false;
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
