#pragma once
// Formulas in extended precision as references for core and cpu, and random test data.

#include "core/kernel/recurrence.hpp"
#include "core/lcp/matrix.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace bromwich::reference {

using Real = long double;

inline constexpr double pi = std::numbers::pi;

inline const Matrix cycling{{1, 0, 2}, {2, 1, 0}, {0, 2, 1}};  ///< P; semismooth Newton cycles at q = -1
inline const Matrix fold{{1, -2}, {-2, 1}};                    ///< Z, not P: two solutions if q is in the fold

inline Tridiagonal tridiagonal(Index n, double lower, double diagonal, double upper) {
  return {Vector::Constant(n, lower), Vector::Constant(n, diagonal), Vector::Constant(n, upper)};
}

/// (e^x - 1)/x.
inline Real phi1(Real x) { return x == 0 ? 1 : std::expm1(x) / x; }

/// (e^x - 1 - x)/x^2; by the series where the formula cancels.
inline Real phi2(Real x) {
  if (std::abs(x) > 1) return (phi1(x) - 1) / x;
  Real term = 0.5L, sum = 0;
  for (int k = 3; k < 30; ++k) {
    sum += term;
    term *= x / Real(k);
  }
  return sum;
}

/// Eigenvalue k = 1..points of the second difference.
inline Real eigenvalue(const SecondDifference& d, Index k) {
  const Real s = std::sin(std::numbers::pi_v<Real> * Real(k) / Real(2 * (d.points + 1)));
  return -4 * Real(d.diffusivity) / (Real(d.spacing) * Real(d.spacing)) * s * s;
}

/// sqrt(2/(n+1)) sin(pi i k/(n+1)), i, k = 1..n.
inline Matrix sine_matrix(Index n) {
  Matrix S(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k < n; ++k)
      S(i, k) = double(std::sqrt(2 / Real(n + 1)) *
                       std::sin(std::numbers::pi_v<Real> * Real((i + 1) * (k + 1) % (2 * (n + 1))) / Real(n + 1)));
  return S;
}

/// (n^T s_k)(s_k^T b) for the sine vectors s_k of a line: n^T F(across) b = Σ_k F(eigenvalue k) times this.
inline std::vector<Real> line_coefficients(const KroneckerDynamics& d) {
  const Index K = d.across.points;
  std::vector<Real> c;
  for (Index k = 1; k <= K; ++k) {
    Real seen = 0, driven = 0;
    for (Index i = 0; i < K; ++i) {
      const Real s = std::sin(std::numbers::pi_v<Real> * Real((i + 1) * k % (2 * (K + 1))) / Real(K + 1));
      seen += s * Real(d.n[i]);
      driven += s * Real(d.b[i]);
    }
    c.push_back(2 / Real(K + 1) * seen * driven);
  }
  return c;
}

/// Weights of piecewise-linear y as sums over all eigenvalues, for every `stride`-th mode (the others stay zero).
inline LagTable modal_weights(const KroneckerDynamics& d, double h, Index J, Index stride = 1) {
  const Index n = d.along.points;
  LagTable table{n, n, true, RowMatrix::Zero(J + 1, n), RowMatrix::Zero(J + 1, n)};
  const std::vector<Real> c = line_coefficients(d);
  std::vector<Real> W(std::size_t(J + 1)), S(W.size());
  for (Index l = 0; l < n; l += stride) {
    std::fill(W.begin(), W.end(), Real(0));
    std::fill(S.begin(), S.end(), Real(0));
    for (Index k = 0; k < d.across.points; ++k) {
      const Real x = Real(h) * (eigenvalue(d.along, l + 1) + eigenvalue(d.across, k + 1)), p1 = phi1(x), p2 = phi2(x);
      const Real decay = std::exp(x), factor = Real(h) * c[std::size_t(k)];
      W[0] += factor * p2;
      Real power = factor;
      // Terms below 1e-60 are negligible (and denormals are slow).
      for (std::size_t lag = 1; lag < W.size() && std::abs(power) > 1e-60L; ++lag, power *= decay) {
        W[lag] += power * p1 * p1;
        S[lag] += power * (p1 - p2);
      }
    }
    for (Index lag = 0; lag <= J; ++lag) {
      table.W(lag, l) = double(W[std::size_t(lag)]);
      table.S(lag, l) = double(S[std::size_t(lag)]);
    }
  }
  return table;
}

/// v_j = Σ_{d<j} W_d y_{j-d} + S_j y_0, v_0 = 0, term by term.
inline RowMatrix convolve(const LagTable& table, const RowMatrix& y) {
  RowMatrix v = RowMatrix::Zero(y.rows(), table.outputs);
  const auto add = [&](const RowMatrix& weights, Index lag, Index from, Index to) {
    if (table.modal)
      v.row(to) += weights.row(lag).cwiseProduct(y.row(from));
    else
      v.row(to).transpose() +=
          Eigen::Map<const RowMatrix>(weights.row(lag).data(), table.outputs, table.inputs) * y.row(from).transpose();
  };
  for (Index j = 1; j < y.rows(); ++j) {
    for (Index d = 0; d < j; ++d) add(table.W, d, j - d, j);
    add(table.S, j, 0, j);
  }
  return v;
}

/// A random source with the shapes that tests need; entries uniform in [-1, 1].
class Random {
 public:
  explicit Random(std::uint32_t seed) : generator_(seed) {}
  double uniform(double low = -1, double high = 1) {
    return std::uniform_real_distribution<double>(low, high)(generator_);
  }
  Matrix matrix(Index rows, Index cols) {
    return Matrix::NullaryExpr(rows, cols, [this](Index, Index) { return uniform(); });
  }
  Vector vector(Index size) { return matrix(size, 1); }
  /// Strictly diagonally dominant by rows with random signs: a P-matrix.
  Matrix dominant(Index n) {
    Matrix M = matrix(n, n);
    for (Index i = 0; i < n; ++i) M(i, i) = M.row(i).cwiseAbs().sum() - std::abs(M(i, i)) + uniform(0.1, 1);
    return M;
  }

 private:
  std::mt19937 generator_;
};

/// The line of the Signorini scene with Q points: second differences, b = c/dx^2 e_1, n = -2 e_1.
inline KroneckerDynamics signorini_dynamics(Index along, Index across, double c = 2e-3) {
  const double dx = 1.0 / double(across + 1);
  KroneckerDynamics d{{along, 1.0 / double(along + 1), c}, {across, dx, c}, Vector::Zero(across), Vector::Zero(across)};
  d.b[0] = c / (dx * dx);
  d.n[0] = -2;
  return d;
}

}  // namespace bromwich::reference
