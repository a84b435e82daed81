#include "core/kernel/resolution.hpp"

#include "core/lcp/solution.hpp"
#include "core/numerics/sectorial.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

namespace bromwich {

namespace {

constexpr std::size_t most_sets = 16;
constexpr Index most_samples = 64;  ///< rows of an active set whose states are tested for its modes

// An active set of y: its rows, and the largest number of consecutive steps it lasts.
struct Phase {
  std::vector<Index> rows;
  Index longest = 0;
};

std::map<std::vector<Index>, Phase> phases(const RowMatrix& y) {
  std::map<std::vector<Index>, Phase> found;
  Index length = 0;
  Phase* phase = nullptr;
  for (Index j = 1; j < y.rows(); ++j) {
    const bool same = j > 1 && ((y.row(j).array() > 0) == (y.row(j - 1).array() > 0)).all();
    length = same ? length + 1 : 1;
    if (!same) {
      const std::vector<Index> S = support_of(y.row(j).transpose());
      phase = found.size() == most_sets && !found.count(S) ? nullptr : &found[S];
    }
    if (!phase) continue;
    phase->rows.push_back(j);
    phase->longest = std::max(phase->longest, length);
  }
  return found;
}

// The fastest mode of any phase that `counts` accepts and whose amplitude in the states exceeds `least_amplitude`.
std::optional<Complex> fastest(const DiscreteProblem& p, const RowMatrix& y, const RowMatrix& x, double least_amplitude,
                               const std::function<bool(Complex z, Index steps)>& counts) {
  const Vector scale = x.cwiseAbs().colwise().maxCoeff().transpose();
  if (!x.allFinite() || !(scale.maxCoeff() > 0)) return std::nullopt;
  const Vector D = scale.cwiseMax(1e-8 * scale.maxCoeff());
  const DenseDynamics& d = *p.small_state();
  const Matrix M = to_dense(p.scene.M);
  std::optional<Complex> found;
  for (const auto& [S, phase] : phases(y)) {
    const std::optional<Matrix> closed = closed_matrix(d.A, d.B, d.N, M, S);
    if (!closed || !closed->allFinite()) continue;
    const Matrix scaled = D.cwiseInverse().asDiagonal() * *closed * D.asDiagonal();
    const auto counting = [&, steps = phase.longest](const ComplexVector& lambda) {
      std::vector<Index> which;
      for (Index k = 0; k < lambda.size(); ++k)
        if (counts(p.h * lambda[k], steps)) which.push_back(k);
      return which;
    };
    // Most scenes have no such mode, and eigenvalues alone are cheaper.
    if (const Eigen::EigenSolver<Matrix> values(scaled, false);
        values.info() != Eigen::Success || counting(values.eigenvalues()).empty())
      continue;
    const Eigen::EigenSolver<Matrix> eigen(scaled);
    if (eigen.info() != Eigen::Success) continue;
    const ComplexVector lambda = eigen.eigenvalues();
    const std::vector<Index> candidates = counting(lambda);
    const Eigen::PartialPivLU<ComplexMatrix> modes(eigen.eigenvectors());
    const bool known = modes.rcond() > 1e-10;
    const std::size_t stride = std::max<std::size_t>(1, phase.rows.size() / std::size_t(most_samples));
    Vector largest = known ? Vector(Vector::Zero(lambda.size())) : Vector(Vector::Ones(lambda.size()));
    for (std::size_t k = 0; known && k < phase.rows.size(); k += stride) {
      const Vector state = x.row(phase.rows[k]).transpose().cwiseQuotient(D);
      largest = largest.cwiseMax(modes.solve(state.cast<Complex>().eval()).cwiseAbs());
    }
    for (const Index k : candidates)
      if (largest[k] > least_amplitude && (!found || std::abs(lambda[k]) > std::abs(*found))) found = lambda[k];
  }
  return found;
}

bool grows(Complex z, Index steps) {
  return std::abs(z) > 0.5 && z.real() > 1e-6 * std::abs(z) && z.real() * double(steps) > 0.1;
}

}  // namespace

std::optional<Matrix> closed_matrix(const Matrix& A, const Matrix& B, const Matrix& N, const Matrix& M,
                                    const std::vector<Index>& S) {
  constexpr double regular = 1e-12;
  if (S.empty()) return A;
  const Matrix B_S = B(Eigen::all, S), N_S = N(S, Eigen::all), M_S = M(S, S);
  const Eigen::FullPivLU<Matrix> lu(M_S);
  if (lu.isInvertible() && lu.rcond() > regular) return Matrix(A - B_S * Matrix(lu.solve(N_S)));
  const Eigen::FullPivLU<Matrix> velocity(N_S * B_S);
  if (M_S.isZero(0) && velocity.isInvertible() && velocity.rcond() > regular)
    return Matrix(A - B_S * Matrix(velocity.solve(Matrix(N_S * A))));
  return std::nullopt;
}

std::optional<Complex> damped_growth(const DiscreteProblem& p, const RowMatrix& y, const RowMatrix& x,
                                     double (*damping)(Complex z)) {
  constexpr double weakly = 0.5;          // of |z|: weaker growth is that of an oscillation
  constexpr double least_damped = 1e-12;  // of the state: decay has hidden the mode
  return fastest(p, y, x, least_damped, [damping](Complex z, Index steps) {
    return grows(z, steps) && z.real() > weakly * std::abs(z) && damping(z) < 0;
  });
}

std::optional<Complex> unresolved_oscillation(const DiscreteProblem& p, const RowMatrix& y, const RowMatrix& x,
                                              double (*damping)(Complex z)) {
  return fastest(p, y, x, 0.1, [damping](Complex z, Index steps) {
    constexpr double third = 0.4;  // log(3/2)
    return std::abs(z.real()) < 0.1 * std::abs(z.imag()) && double(steps) * std::abs(damping(z) - z.real()) > third;
  });
}

double euler_damping(Complex z) { return -std::log(std::abs(1.0 - z)); }

double radau_damping(Complex z) { return std::log(std::abs((1.0 + z / 3.0) / (1.0 - 2.0 * z / 3.0 + z * z / 6.0))); }

}  // namespace bromwich
