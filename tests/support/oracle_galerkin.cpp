#include "tests/support/oracle_galerkin.hpp"

#include "tests/support/oracle.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich::oracle {
namespace {

constexpr Index points = 16;  ///< of a Gauss rule: exact to degree 31, rounding for |hA| below 10

struct Rule {
  Vector node, weight;  ///< on [0, 1]
};

/// Golub and Welsch.
Rule gauss_rule() {
  Matrix jacobi = Matrix::Zero(points, points);
  for (Index k = 1; k < points; ++k)
    jacobi(k, k - 1) = jacobi(k - 1, k) = double(k) / std::sqrt(4.0 * double(k) * double(k) - 1);
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(jacobi);
  return {(eigen.eigenvalues().array() + 1) / 2, eigen.eigenvectors().row(0).cwiseAbs2().transpose()};
}

double hat(Index end, double s) { return end == 0 ? 1 - s : s; }

/// The operators of one interval, by quadrature, for each end e.
struct Interval {
  Matrix decay;                ///< e^{hA}
  std::array<Matrix, 2> seen;  ///< (2/h) ∫ psi_e(t) N e^{tA} dt, n x m: from the left state to the equations
  std::array<Matrix, 2> made;  ///< ∫ e^{(h-s)A} B psi_e(s) ds, m x n: from y to the right state
  Matrix own;                  ///< 2n x 2n: from y of the interval to its own equations, including M
};

Interval integrate(const DenseScene& s, double h, const Rule& gauss) {
  const Index m = s.A.rows(), n = s.M.rows();
  Interval one;
  one.decay = exponential(h * s.A);
  one.own = Matrix::Zero(2 * n, 2 * n);
  for (Index e = 0; e < 2; ++e) {
    one.seen[std::size_t(e)] = Matrix::Zero(n, m);
    one.made[std::size_t(e)] = Matrix::Zero(m, n);
    for (Index a = 0; a < points; ++a) {
      const double tau = gauss.node[a], weight = gauss.weight[a];
      one.seen[std::size_t(e)] += 2 * weight * hat(e, tau) * s.N * exponential(tau * h * s.A);
      one.made[std::size_t(e)] += h * weight * hat(e, tau) * exponential((1 - tau) * h * s.A) * s.B;
    }
  }
  for (Index a = 0; a < points; ++a) {
    const double tau = gauss.node[a];
    for (Index b = 0; b < points; ++b) {
      const double sigma = tau * gauss.node[b];  // from 0 to tau
      const Matrix kernel = s.N * exponential((tau - sigma) * h * s.A) * s.B;
      for (Index row = 0; row < 2; ++row)
        for (Index col = 0; col < 2; ++col)
          one.own.block(row * n, col * n, n, n) +=
              2 * h * gauss.weight[a] * tau * gauss.weight[b] * hat(row, tau) * hat(col, sigma) * kernel;
    }
    for (Index row = 0; row < 2; ++row)
      for (Index col = 0; col < 2; ++col)
        one.own.block(row * n, col * n, n, n) += 2 * gauss.weight[a] * hat(row, tau) * hat(col, tau) * s.M;
  }
  return one;
}

/// ∫_0^length e^{(length-s)A} f(from + s) ds.
Vector driven(const DenseScene& s, double from, double length, const Rule& gauss) {
  Vector sum = Vector::Zero(s.A.rows());
  for (Index b = 0; b < points; ++b)
    sum += length * gauss.weight[b] * exponential((1 - gauss.node[b]) * length * s.A) *
           value(s.f, from + gauss.node[b] * length, s.A.rows());
  return sum;
}

struct Ends {
  Matrix E0, ET;
  Vector b;
};

Ends ends_of(const Scene& scene, Index m) {
  if (scene.boundary) return {scene.boundary->E0, scene.boundary->ET, scene.boundary->b};
  return {Matrix::Identity(m, m), Matrix::Zero(m, m), scene.x0};
}

DenseScene without_x0(const Scene& scene) {
  Scene copy = scene;
  if (scene.boundary) copy.x0 = Vector::Zero(scene.states());
  return write_out(copy);
}

/// Response of the state to f at the nodes with x(0) = 0: columns 0..J.
Matrix driven_states(const DenseScene& s, Index J, const Rule& gauss) {
  const double h = s.T / double(J);
  const Matrix decay = exponential(h * s.A);
  Matrix x = Matrix::Zero(s.A.rows(), J + 1);
  for (Index k = 0; k < J; ++k) x.col(k + 1) = decay * x.col(k) + driven(s, h * double(k), h, gauss);
  return x;
}

}  // namespace

GalerkinSystem galerkin_system(const Scene& scene, Index J) {
  const DenseScene s = without_x0(scene);
  const Rule gauss = gauss_rule();
  const Index m = s.A.rows(), n = s.M.rows(), block = 2 * n;
  const double h = s.T / double(J);
  const Interval one = integrate(s, h, gauss);
  const Ends ends = ends_of(scene, m);
  const Eigen::FullPivLU<Matrix> shooting(ends.E0 + ends.ET * exponential(s.T * s.A));

  Matrix made(m, block), seen(block, m);
  made << one.made[0], one.made[1];
  seen << one.seen[0], one.seen[1];
  std::vector<Matrix> power;  // e^{dhA}, each from its own exponential
  for (Index d = 0; d <= J; ++d) power.push_back(exponential(double(d) * h * s.A));

  GalerkinSystem system{Matrix::Zero(J * block, J * block), Vector(J * block), {}};
  for (Index row = 0; row < J; ++row)
    for (Index col = 0; col < J; ++col) {
      auto entry = system.matrix.block(row * block, col * block, block, block);
      if (row == col) entry = one.own;
      if (row > col) entry = seen * power[std::size_t(row - col - 1)] * made;
      entry -=
          seen * power[std::size_t(row)] * shooting.solve(Matrix(ends.ET * power[std::size_t(J - col - 1)] * made));
    }

  const Matrix from_f = driven_states(s, J, gauss);
  const Vector start = shooting.solve(Vector(ends.b - ends.ET * from_f.col(J)));
  system.q.setZero();
  for (Index k = 0; k < J; ++k)
    for (Index a = 0; a < points; ++a) {
      const double from = h * double(k), tau = gauss.node[a], t = from + tau * h;
      const Vector x = exponential(tau * h * s.A) * (power[std::size_t(k)] * start + from_f.col(k)) +
                       driven(s, from, tau * h, gauss);
      const Vector w = s.N * x + value(s.g, t, n);
      for (Index e = 0; e < 2; ++e) system.q.segment(k * block + e * n, n) += 2 * gauss.weight[a] * hat(e, tau) * w;
    }
  for (Index k = 0; k < 2 * J; ++k)
    for (const Index i : scene.free_rows) system.free.push_back(k * n + i);
  return system;
}

std::optional<Vector> lemke(const Matrix& M, const Vector& q) {
  const Index n = q.size();
  Vector y = Vector::Zero(n);
  if (n == 0 || q.minCoeff() >= 0) return y;
  // w - M y - e y_0 = q. Columns: w (0..n-1), y (n..2n-1), y_0 (2n), and q last. The columns of w also hold the inverse
  // of the basis, which breaks ties of the ratio test lexicographically.
  Matrix tableau(n, 2 * n + 2);
  tableau << Matrix::Identity(n, n), -M, -Vector::Ones(n), q;
  std::vector<Index> basis;
  for (Index i = 0; i < n; ++i) basis.push_back(i);
  const auto pivot = [&](Index row, Index column) {
    tableau.row(row) /= tableau(row, column);
    for (Index i = 0; i < n; ++i)
      if (i != row && tableau(i, column) != 0) tableau.row(i) -= tableau(i, column) * tableau.row(row);
    const Index left = basis[std::size_t(row)];
    basis[std::size_t(row)] = column;
    return left;
  };
  const auto before = [&](Index a, Index b, Index column) {  // whether row a leaves rather than row b
    for (Index c = -1; c < n; ++c) {
      const Index place = c < 0 ? 2 * n + 1 : c;
      const double left = tableau(a, place) / tableau(a, column), right = tableau(b, place) / tableau(b, column);
      if (std::abs(left - right) > 1e-13 * std::max(1., std::abs(left))) return left < right;
    }
    return false;
  };
  Index row = 0;
  q.minCoeff(&row);
  Index left = pivot(row, 2 * n);
  for (Index count = 0; count < 50 * n; ++count) {
    const Index entering = left < n ? left + n : left - n;
    row = -1;
    for (Index i = 0; i < n; ++i)
      if (tableau(i, entering) > 1e-11 && (row < 0 || before(i, row, entering))) row = i;
    if (row < 0) return std::nullopt;
    // y_0 leaves as soon as possible.
    for (Index i = 0; i < n; ++i)
      if (basis[std::size_t(i)] == 2 * n && tableau(i, entering) > 1e-11 && !before(row, i, entering)) row = i;
    left = pivot(row, entering);
    if (left != 2 * n) continue;
    // Only the active set is used; its equations are solved again, without the rounding errors of the pivots.
    std::vector<Index> S;
    for (const Index b : basis)
      if (b >= n) S.push_back(b - n);
    if (!S.empty()) y(S) = Vector(Matrix(M(S, S)).fullPivLu().solve(Vector(-q(S))));
    return y;
  }
  return std::nullopt;
}

std::optional<RowMatrix> galerkin_solution(const GalerkinSystem& system, Index J) {
  const Index size = system.q.size();
  std::vector<Index> kept;
  for (Index i = 0; i < size; ++i)
    if (std::find(system.free.begin(), system.free.end(), i) == system.free.end()) kept.push_back(i);
  const std::vector<Index>& free = system.free;
  Vector y = Vector::Zero(size);
  const Matrix& L = system.matrix;
  if (free.empty()) {
    const auto found = lemke(L, system.q);
    if (!found) return std::nullopt;
    y = *found;
  } else {
    const Eigen::FullPivLU<Matrix> lu(Matrix(L(free, free)));
    const Matrix coupling = lu.solve(Matrix(L(free, kept)));
    const Vector offset = lu.solve(Vector(system.q(free)));
    const auto found = lemke(L(kept, kept) - L(kept, free) * coupling, system.q(kept) - L(kept, free) * offset);
    if (!found) return std::nullopt;
    y(kept) = *found;
    y(free) = -offset - coupling * *found;
  }
  return RowMatrix(Eigen::Map<const RowMatrix>(y.data(), J, size / J));
}

RowMatrix galerkin_states(const Scene& scene, const RowMatrix& y) {
  const DenseScene s = without_x0(scene);
  const Rule gauss = gauss_rule();
  const Index m = s.A.rows(), n = s.M.rows(), J = y.rows();
  const double h = s.T / double(J);
  const Interval one = integrate(s, h, gauss);
  const Ends ends = ends_of(scene, m);
  Matrix x = driven_states(s, J, gauss), drive = Matrix::Zero(m, J + 1);
  for (Index k = 0; k < J; ++k)
    drive.col(k + 1) = one.decay * drive.col(k) + one.made[0] * y.row(k).head(n).transpose() +
                       one.made[1] * y.row(k).tail(n).transpose();
  x += drive;
  const Matrix shooting = ends.E0 + ends.ET * exponential(s.T * s.A);
  const Vector start = shooting.fullPivLu().solve(Vector(ends.b - ends.ET * x.col(J)));
  for (Index k = 0; k <= J; ++k) x.col(k) += exponential(double(k) * h * s.A) * start;
  return x.transpose();
}

double galerkin_residual(const GalerkinSystem& system, const RowMatrix& y) {
  const Eigen::Map<const Vector> z(y.data(), y.size());
  const Vector w = system.matrix * z + system.q;
  Vector natural = z.cwiseMin(w);
  natural(system.free) = w(system.free);
  return natural.cwiseAbs().maxCoeff();
}

double smallest_galerkin_eigenvalue(const GalerkinSystem& system, Index J) {
  const Index size = system.q.size(), n = size / (2 * J);
  Matrix mass = Matrix::Zero(size, size);
  for (Index k = 0; k < J; ++k)
    for (Index i = 0; i < n; ++i)
      for (Index row = 0; row < 2; ++row)
        for (Index col = 0; col < 2; ++col)
          mass((2 * k + row) * n + i, (2 * k + col) * n + i) = row == col ? 2. / 3 : 1. / 3;
  const Matrix symmetric = (system.matrix + system.matrix.transpose()) / 2;
  return Eigen::GeneralizedSelfAdjointEigenSolver<Matrix>(symmetric, mass, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .minCoeff();
}

}  // namespace bromwich::oracle
