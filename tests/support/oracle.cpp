#include "tests/support/oracle.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/KroneckerProduct>
#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

namespace bromwich::oracle {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

double norm_inf(const Matrix& A) { return A.size() == 0 ? 0 : A.cwiseAbs().rowwise().sum().maxCoeff(); }

Matrix second_difference(const SecondDifference& d) {
  Matrix D(d.points, d.points);
  for (Index i = 0; i < d.points; ++i)
    for (Index j = 0; j < d.points; ++j)
      D(i, j) = d.diffusivity / (d.spacing * d.spacing) * (i == j ? -2 : std::abs(i - j) == 1 ? 1 : 0);
  D(0, 0) += d.diffusivity / (d.spacing * d.spacing) * d.first;
  D(d.points - 1, d.points - 1) += d.diffusivity / (d.spacing * d.spacing) * d.last;
  D.diagonal().array() -= d.decay;
  return D;
}

struct Candidate {
  Vector y;
  double residual;
};

/// One candidate per active set S with nonsingular M_SS: y_S = -M_SS^{-1} q_S, y = 0 elsewhere.
std::vector<Candidate> candidates(const Matrix& M, const Vector& q) {
  const Index n = q.size();
  if (n > 10) throw std::invalid_argument("oracle: at most 10 constraints");
  std::vector<Candidate> all;
  for (unsigned set = 0; set < (1u << n); ++set) {
    const std::vector<Index> S = members(set, n);
    Vector y = Vector::Zero(n);
    if (!S.empty()) {
      const Eigen::FullPivLU<Matrix> lu(M(S, S));
      if (!lu.isInvertible()) continue;
      y(S) = Vector(lu.solve(Vector(-q(S))));
    }
    const Vector w = M * y + q;
    const double scale = 1 + q.cwiseAbs().maxCoeff() + norm_inf(M) * y.cwiseAbs().maxCoeff();
    all.push_back({y.cwiseMax(0), y.cwiseMin(w).cwiseAbs().maxCoeff() / scale});
  }
  return all;
}

/// Bound for the rounding error of a solve of size n <= 10.
constexpr double solved_by_a_set = 1e-12;

/// One step: y with 0 <= y ⊥ q + (M + W0) y >= 0; for Z also the least element of LCP(M, q + W0 y).
std::optional<Vector> solve_step(const DenseScene& s, const Matrix& W0, const Vector& q) {
  const Matrix shifted = s.M + W0;
  if (s.lcp_class != LcpClass::Z) return solve_lcp(shifted, q, s.lcp_class);
  for (const Candidate& c : candidates(shifted, q)) {
    if (c.residual > solved_by_a_set) continue;
    const auto least = solve_lcp(s.M, q + W0 * c.y, LcpClass::Z);
    if (least && (*least - c.y).cwiseAbs().maxCoeff() <= 1e-8 * (1 + c.y.cwiseAbs().maxCoeff())) return c.y;
  }
  return std::nullopt;
}

Trajectory empty_trajectory(const DenseScene& s, Index J) {
  const Index n = s.M.rows(), m = s.A.rows();
  return {Vector::LinSpaced(J + 1, 0, s.T), RowMatrix::Constant(J + 1, n, NAN), RowMatrix::Constant(J + 1, m, NAN), -1};
}

/// Both schemes: x_{j+1} = from(x_j, y_j, j) + D y_{j+1}.
Trajectory step_by_step(const DenseScene& s, Index J, const Matrix& D,
                        const std::function<Vector(const Vector& x, const Vector& y, Index j)>& from) {
  const Index n = s.M.rows();
  Trajectory out = empty_trajectory(s, J);
  Vector x = s.x0;
  auto y = solve_lcp(s.M, s.N * x + value(s.g, 0, n), s.lcp_class);
  for (Index j = 0; y; ++j) {
    out.x.row(j) = x;
    out.y.row(j) = *y;
    if (j == J) return out;
    const Vector start = from(x, *y, j);
    y = solve_step(s, s.N * D, s.N * start + value(s.g, out.t[j + 1], n));
    if (y)
      x = start + D * *y;
    else
      out.infeasible = j + 1;
  }
  if (out.infeasible < 0) out.infeasible = 0;
  return out;
}

/// Nodes and weights on [0,1] (Golub and Welsch).
std::pair<Vector, Vector> gauss_legendre(Index points) {
  Matrix jacobi = Matrix::Zero(points, points);
  for (Index k = 1; k < points; ++k)
    jacobi(k, k - 1) = jacobi(k - 1, k) = double(k) / std::sqrt(4.0 * double(k) * double(k) - 1);
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(jacobi);
  return {(eigen.eigenvalues().array() + 1) / 2, eigen.eigenvectors().row(0).cwiseAbs2().transpose()};
}

}  // namespace

Vector value(const TimeFunction& function, double t, Index size) {
  Vector out(size);
  function(t, out);
  return out;
}

std::vector<Index> members(unsigned set, Index n) {
  std::vector<Index> indices;
  for (Index i = 0; i < n; ++i)
    if (set >> i & 1u) indices.push_back(i);
  return indices;
}

double smallest_principal_minor(const Matrix& M) {
  double smallest = INFINITY;
  for (unsigned set = 1; set < 1u << M.rows(); ++set) {
    const std::vector<Index> S = members(set, M.rows());
    smallest = std::min(smallest, Matrix(M(S, S)).determinant());
  }
  return smallest;
}

DenseScene write_out(const Scene& scene) {
  DenseScene s;
  if (const auto* dense = get_if<DenseDynamics>(&scene.dynamics)) {
    s.A = dense->A;
    s.B = dense->B;
    s.N = dense->N;
  } else if (const auto* sparse = get_if<SparseDynamics>(&scene.dynamics)) {
    s.A = sparse->A;
    s.B = sparse->B;
    s.N = sparse->N;
  } else {
    const auto& k = get<KroneckerDynamics>(scene.dynamics);
    Matrix face = second_difference(k.along);
    for (const SecondDifference& beside : k.beside) {
      const Matrix next = second_difference(beside), before = face;
      face = Eigen::kroneckerProduct(before, Matrix::Identity(next.rows(), next.rows())).eval() +
             Eigen::kroneckerProduct(Matrix::Identity(before.rows(), before.rows()), next).eval();
    }
    const Matrix lines = Matrix::Identity(face.rows(), face.rows());
    const Matrix line = Matrix::Identity(k.across.points, k.across.points);
    s.A =
        Eigen::kroneckerProduct(lines, second_difference(k.across)).eval() + Eigen::kroneckerProduct(face, line).eval();
    s.B = Eigen::kroneckerProduct(lines, k.b).eval();
    s.N = Eigen::kroneckerProduct(lines, k.n.transpose()).eval();
  }
  if (const auto* dense = std::get_if<Matrix>(&scene.M)) {
    s.M = *dense;
  } else if (const SparseMatrix* sparse = sparse_of(scene.M)) {
    s.M = Matrix(*sparse);
  } else {
    const auto& t = std::get<Tridiagonal>(scene.M);
    const Index n = t.diagonal.size();
    s.M = Matrix::Zero(n, n);
    for (Index i = 0; i < n; ++i) {
      s.M(i, i) = t.diagonal[i];
      if (i > 0) s.M(i, i - 1) = t.lower[i];
      if (i + 1 < n) s.M(i, i + 1) = t.upper[i];
    }
  }
  s.lcp_class = scene.lcp_class;
  if (s.lcp_class == LcpClass::automatic) s.lcp_class = s.M.rows() <= 10 ? class_of(s.M) : LcpClass::P;
  const TimeFunction zero = [](double, Eigen::Ref<Vector> v) { v.setZero(); };
  s.g = scene.g ? scene.g : zero;
  s.f = scene.f ? scene.f : zero;
  if (scene.f && scene.f_entry == SourceEntry::through_B)
    s.f = [phi = scene.f, B = s.B](double t, Eigen::Ref<Vector> f) { f = B * value(phi, t, B.cols()); };
  if (scene.f && scene.f_entry == SourceEntry::through_F)
    s.f = [phi = scene.f, F = Matrix(scene.F)](double t, Eigen::Ref<Vector> f) { f = F * value(phi, t, F.cols()); };
  s.x0 = scene.x0;
  s.T = scene.T;
  return s;
}

Matrix exponential(const Matrix& X) { return X.exp(); }

Phi phi_functions(const Matrix& X) {
  const Index m = X.rows();
  Matrix augmented = Matrix::Zero(3 * m, 3 * m);
  augmented.topLeftCorner(m, m) = X;
  augmented.block(0, m, m, m).setIdentity();
  augmented.block(m, 2 * m, m, m).setIdentity();
  const Matrix e = exponential(augmented);
  return {e.topLeftCorner(m, m), e.block(0, m, m, m), e.block(0, 2 * m, m, m)};
}

Weights weights(const DenseScene& s, double h, Index J) {
  const Phi phi = phi_functions(h * s.A);
  Weights out{{h * s.N * phi.phi2 * s.B}, {Matrix::Zero(s.N.rows(), s.B.cols())}};
  Matrix decayed = h * s.N;  // h N e^{(d-1)hA}
  for (Index d = 1; d <= J; ++d, decayed = decayed * phi.exponential) {
    out.W.push_back(decayed * phi.phi1 * phi.phi1 * s.B);
    out.S.push_back(decayed * (phi.phi1 - phi.phi2) * s.B);
  }
  return out;
}

Weights quadrature_weights(const DenseScene& s, double h, Index J) {
  const auto [nodes, w] = gauss_legendre(16);
  const Matrix zero = Matrix::Zero(s.N.rows(), s.B.cols());
  Weights out;
  out.W.assign(std::size_t(J + 1), zero);
  out.S.assign(std::size_t(J + 1), zero);
  for (Index i = 0; i < nodes.size(); ++i) {
    const double a = nodes[i];  // lag within an interval: t - s = (d - 1 + a) h or (d + a) h
    const Matrix in_interval = exponential(a * h * s.A) * s.B, step = exponential(h * s.A);
    Matrix decayed = s.N;
    for (Index k = 0; k <= J; ++k, decayed = decayed * step) {
      const Matrix K = h * w[i] * decayed * in_interval;  // part of ∫ over lags in [k h, (k+1) h]
      out.W[std::size_t(k)] += (1 - a) * K;               // falling part of the hat of lag k
      if (k < J) {                                        // rising part of the hat of lag k+1
        out.W[std::size_t(k + 1)] += a * K;
        out.S[std::size_t(k + 1)] += a * K;
      }
    }
  }
  return out;
}

std::optional<Vector> solve_lcp(const Matrix& M, const Vector& q, LcpClass lcp_class) {
  const std::vector<Candidate> all = candidates(M, q);
  if (lcp_class == LcpClass::Z) {
    std::optional<Vector> least;
    for (const Candidate& c : all)
      if (c.residual <= solved_by_a_set) least = least ? Vector(least->cwiseMin(c.y)) : c.y;
    return least;
  }
  const Candidate* best = nullptr;
  for (const Candidate& c : all)
    if (!best || c.residual < best->residual) best = &c;
  if (best->residual > solved_by_a_set) return std::nullopt;
  return best->y;
}

double lipschitz(const Matrix& M) {
  double L = 0;
  for (unsigned set = 1; set < (1u << M.rows()); ++set) {
    const std::vector<Index> S = members(set, M.rows());
    const Eigen::FullPivLU<Matrix> lu(M(S, S));
    if (!lu.isInvertible()) return infinity;
    L = std::max(L, norm_inf(lu.inverse()));
  }
  return L;
}

Trajectory march(const DenseScene& s, Index J) {
  const double h = s.T / double(J);
  const Phi phi = phi_functions(h * s.A);
  const Matrix left = h * (phi.phi1 - phi.phi2), right = h * phi.phi2;
  const Index m = s.A.rows();
  return step_by_step(s, J, right * s.B, [&](const Vector& x, const Vector& y, Index j) {
    const double t0 = h * double(j), t1 = h * double(j + 1);
    return Vector(phi.exponential * x + left * (s.B * y + value(s.f, t0, m)) + right * value(s.f, t1, m));
  });
}

Trajectory euler(const DenseScene& s, Index J) {
  const double h = s.T / double(J);
  const Index m = s.A.rows();
  const Matrix R = (Matrix::Identity(m, m) - h * s.A).inverse();
  return step_by_step(s, J, h * R * s.B, [&](const Vector& x, const Vector&, Index j) {
    return Vector(R * (x + h * value(s.f, h * double(j + 1), m)));
  });
}

RowMatrix states_of(const DenseScene& s, const RowMatrix& y) {
  const Index J = y.rows() - 1, m = s.A.rows();
  const double h = s.T / double(J);
  const Phi phi = phi_functions(h * s.A);
  RowMatrix x(J + 1, m);
  x.row(0) = s.x0;
  Vector before = s.B * y.row(0).transpose() + value(s.f, 0, m);
  for (Index j = 1; j <= J; ++j) {
    const Vector now = s.B * y.row(j).transpose() + value(s.f, h * double(j), m);
    x.row(j) = phi.exponential * x.row(j - 1).transpose() + h * (phi.phi1 - phi.phi2) * before + h * phi.phi2 * now;
    before = now;
  }
  return x;
}

double complementarity_residual(const DenseScene& s, const RowMatrix& y, const RowMatrix& x) {
  if (!y.allFinite() || !x.allFinite()) return NAN;
  const Index J = y.rows() - 1;
  double worst = 0;
  for (Index j = 0; j <= J; ++j) {
    const Vector yj = y.row(j), q = s.N * x.row(j).transpose() + value(s.g, s.T * double(j) / double(J), yj.size());
    const Vector w = s.M * yj + q;
    worst = std::max(worst, yj.cwiseMin(w).cwiseAbs().maxCoeff() / std::max(1.0, q.cwiseAbs().maxCoeff()));
  }
  return worst;
}

Scene random_scene(std::uint32_t seed, Index m, Index n, SpectrumKind spectrum, MatrixKind kind) {
  std::mt19937 engine(seed);
  const auto uniform = [&](double a, double b) { return a + (b - a) * double(engine()) / 4294967296.0; };
  const auto random_matrix = [&](Index rows, Index cols) {
    return Matrix(Matrix::NullaryExpr(rows, cols, [&] { return uniform(-1, 1); }));
  };

  Matrix blocks = Matrix::Zero(m, m);
  for (Index i = 0; i + 1 < m && spectrum != SpectrumKind::real_negative; i += 2) {
    const double omega = uniform(0.5, 6), damping = spectrum == SpectrumKind::sector ? omega * uniform(1, 3) : 0;
    blocks.block(i, i, 2, 2) << -damping, omega, -omega, -damping;
  }
  for (Index i = 0; i < m; ++i)
    if (spectrum == SpectrumKind::real_negative)
      blocks(i, i) = -uniform(0.1, 20);
    else if (i + 1 == m && m % 2 == 1)
      blocks(i, i) = spectrum == SpectrumKind::sector ? -1 : 0;
  const Matrix V = Matrix::Identity(m, m) + 0.8 / double(m) * random_matrix(m, m);  // ||V - I||_inf < 1

  Matrix M = random_matrix(n, n);
  if (kind == MatrixKind::positive_definite) {
    const Matrix skew = random_matrix(n, n);
    M = (M * M.transpose() + 0.5 * Matrix::Identity(n, n) + 0.2 * (skew - skew.transpose())).eval();
  } else {
    if (kind == MatrixKind::m_matrix) M = (-M.cwiseAbs()).eval();
    M.diagonal().setZero();
    const Vector rows = M.cwiseAbs().rowwise().sum();
    M.diagonal() = (rows.array() + 0.5 + random_matrix(n, 1).array().abs()).matrix();
  }

  Scene scene;
  scene.name = "random-" + std::to_string(seed);
  scene.dynamics = DenseDynamics{V * blocks * V.inverse(), random_matrix(m, n), random_matrix(n, m)};
  scene.lcp_class = kind == MatrixKind::m_matrix   ? LcpClass::Z
                    : kind == MatrixKind::dominant ? LcpClass::P
                                                   : LcpClass::automatic;
  scene.M = std::move(M);
  const auto sines = [&](Index size, double amplitude) -> TimeFunction {
    const Vector a = amplitude * random_matrix(size, 1), omega = 6 * random_matrix(size, 1),
                 phase = 3 * random_matrix(size, 1);
    return [=](double t, Eigen::Ref<Vector> v) { v = a.array() * (omega.array() * t + phase.array()).sin(); };
  };
  scene.f = sines(m, 2);
  scene.g = sines(n, 3);
  scene.x0 = random_matrix(m, 1);
  scene.T = 1;
  scene.default_steps = 64;
  return scene;
}

}  // namespace bromwich::oracle
