// V of dense dynamics: the step of implicit Euler with y and w exchanged, and what it tells about V.

#include "core/base/text.hpp"
#include "core/dual/dual_weights.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr double negligible_part = 1e-10;  ///< relative: a coefficient that vanishes
constexpr double most_growth = 1e4;        ///< of V over the whole grid
constexpr Index largest_dense = 600;       ///< states, since V takes eigenvalues of such matrices

// det(M + N (zI - A)^{-1} B) is a rational function: zero at two points in general position means zero.
bool is_singular_everywhere(const DenseDynamics& d, const Matrix& M, double h) {
  for (const double z : {1 / h, 0.2718 / h}) {
    const Matrix shifted = z * Matrix::Identity(d.A.rows(), d.A.rows()) - d.A;
    const Matrix symbol = M + d.N * shifted.partialPivLu().solve(d.B);
    if (!symbol.allFinite()) continue;
    const Equilibration e = equilibrate(symbol);
    const Matrix scaled = e.rows.asDiagonal() * symbol * e.columns.asDiagonal();
    if (scaled.partialPivLu().rcond() > 1e3 * epsilon) return false;
  }
  return true;
}

double spectral_radius(const Matrix& E) {
  if (E.size() == 0) return 0;
  const Eigen::EigenSolver<Matrix> eigen(E, false);
  return eigen.info() == Eigen::Success ? eigen.eigenvalues().cwiseAbs().maxCoeff() : INFINITY;
}

// The eigenvalues of V_0^{-1} V^ at high high_frequencies.
std::vector<Complex> relative_symbols(const DenseRecurrence& V) {
  std::vector<Complex> values;
  const Eigen::PartialPivLU<Matrix> V0(V.w0);
  const Index m = V.decay.rows();
  for (Index f = 0; f < high_frequencies; ++f) {
    const Complex z = std::polar(1.0, high_frequency(f));
    const ComplexMatrix shifted = z * ComplexMatrix::Identity(m, m) - V.decay.cast<Complex>();
    const ComplexMatrix far = V.output.cast<Complex>() * shifted.partialPivLu().solve(V.input.cast<Complex>());
    const ComplexMatrix symbol = V.w0.cast<Complex>() + far;
    const ComplexMatrix relative = V0.inverse().cast<Complex>() * symbol;
    const Eigen::ComplexEigenSolver<ComplexMatrix> eigen(relative, false);
    for (const Complex& v : eigen.eigenvalues()) values.push_back(v);
  }
  return values;
}

}  // namespace

// L^T X R is regular for bases L, R of the left and right null space of M: y is determined by M or the first derivative
// of w.
bool has_relative_degree_one(const Matrix& M, const Matrix& NB, const Matrix& terms) {
  const Eigen::FullPivLU<Matrix> right(M), left(Matrix(M.transpose()));
  if (right.isInvertible()) return true;
  const Matrix on_kernel = left.kernel().transpose() * NB * right.kernel();
  const double scale = (left.kernel().cwiseAbs().transpose() * terms * right.kernel().cwiseAbs()).maxCoeff();
  const Eigen::FullPivLU<Matrix> lu(on_kernel);
  return scale > 0 && on_kernel.cwiseAbs().maxCoeff() > negligible_part * scale && lu.isInvertible() &&
         lu.rcond() > negligible_part;
}

DenseRecurrence inverse_recurrence(const DenseDynamics& d, const Matrix& M, double h) {
  const StepOperators step = step_operators(d.A, Rule::implicit_euler, h);
  const Matrix drive = step.right * d.B, seen = d.N * step.decay;
  const Matrix V0 = Matrix(M + d.N * drive).partialPivLu().inverse();
  DenseRecurrence V;
  V.w0 = V0;
  V.input = drive * V0;
  V.output = -V0 * seen;
  V.decay = step.decay - V.input * seen;
  V.start = Matrix::Zero(d.A.rows(), M.rows());
  return V;
}

DualChoice dense_dual_weights(const DiscreteProblem& p) {
  const DenseDynamics& d = *p.small_state();
  const Matrix M = to_dense(p.scene.M);
  if (d.A.rows() > largest_dense) return refused_dual(text("a dense state of more than %ld", long(largest_dense)));
  if (!has_euler_step(d.A, p.h)) return refused_dual("I - hA is singular at this step");
  if (is_singular_everywhere(d, M, p.h)) return refused_dual("M + K has no inverse: constraints repeat each other");
  if (!has_relative_degree_one(M, d.N * d.B, d.N.cwiseAbs() * d.B.cwiseAbs())) return refused_dual(two_derivatives);
  const StepOperators step = step_operators(d.A, Rule::implicit_euler, p.h);
  const Matrix step_matrix = M + d.N * step.right * d.B;
  const Equilibration e = equilibrate(step_matrix);
  const Eigen::PartialPivLU<Matrix> lu(e.rows.asDiagonal() * step_matrix * e.columns.asDiagonal());
  if (!(lu.rcond() > 1e3 * epsilon)) return refused_dual("M + W_0 is singular at this step");
  if (!has_one_solution(classify(LcpMatrix(step_matrix)))) return refused_dual("M + W_0 is not known to be a P-matrix");
  DenseRecurrence V = inverse_recurrence(d, M, p.h);
  const double growth = std::pow(spectral_radius(V.decay), double(p.J));
  if (!(growth <= most_growth))
    return refused_dual(
        text("V grows by %.1e up to T: M + N (zI - A)^{-1} B has zeros in the right half-plane", growth));
  const auto [alpha, factor] = best_divisor(relative_symbols(V));
  const Matrix P = alpha * V.w0;
  V.w0 -= P;
  DualWeights weights;
  weights.P = P;
  weights.weights = share_weights(Recurrence(std::move(V)));
  weights.smoothing = factor;
  weights.error = epsilon * std::max(growth, 1.0);
  weights.description = "V: the step with y and w exchanged";
  return {std::move(weights), ""};
}

}  // namespace bromwich
