// V = (M + K)^{-1} of implicit Euler against convolution quadrature of dense matrices by the trapezoidal rule.

#include "core/dual/dual_weights.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/recurrence.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using reference::Random;

// V_0 .. V_J: coefficients of V^((1 - zeta)/h) from its values on |zeta| = rho, rho^L = 1e-8. Values of lags d + L fold
// back with rho^L, rounding is amplified by rho^-J.
std::vector<Matrix> quadrature(const oracle::DenseScene& s, double h, Index J) {
  const Index L = 64 * J, n = s.M.rows(), m = s.A.rows();
  const double rho = std::pow(1e-8, 1 / double(L));
  std::vector<Matrix> V(std::size_t(J) + 1, Matrix::Zero(n, n));
  for (Index i = 0; i < L; ++i) {
    const double angle = 2 * std::numbers::pi * (double(i) + 0.5) / double(L);
    const Complex z = (1.0 - std::polar(rho, angle)) / h;
    const ComplexMatrix shifted = z * ComplexMatrix::Identity(m, m) - s.A.cast<Complex>();
    const ComplexMatrix K = s.N.cast<Complex>() * shifted.partialPivLu().solve(s.B.cast<Complex>());
    const ComplexMatrix inverse = (s.M.cast<Complex>() + K).inverse();
    for (Index d = 0; d <= J; ++d)
      V[std::size_t(d)] += (inverse * std::polar(std::pow(rho, -double(d)), -double(d) * angle)).real() / double(L);
  }
  return V;
}

void expect_weights(const Scene& scene, Index J) {
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, J);
  const DualChoice choice = dual_weights(p);
  ASSERT_TRUE(choice.weights) << choice.refusal;
  const LagTable table = lag_table(std::get<Recurrence>(*choice.weights->weights), J);
  const Index n = scene.constraints();
  const Matrix S = reference::sine_matrix(n);
  const std::vector<Matrix> expected = quadrature(oracle::write_out(scene), p.h, J);
  const double size = expected[0].cwiseAbs().maxCoeff();
  for (Index d = 0; d <= J; ++d) {
    const Matrix W = table.modal ? Matrix(S * table.W.row(d).asDiagonal() * S)
                                 : Matrix(Eigen::Map<const RowMatrix>(table.W.row(d).data(), n, n));
    const Matrix V = d == 0 ? Matrix(W + to_dense(choice.weights->P)) : W;
    // The rule: rounding of L = 64 J values and 1e-8 J^-1.5 of a folded lag; the fit: 1e-13 of V at |zeta| = 1, which
    // is at most twice V_0 here.
    EXPECT_LE((V - expected[std::size_t(d)]).cwiseAbs().maxCoeff(), 1e-11 * size) << scene.name << ' ' << d;
  }
}

TEST(DualWeights, AreThoseOfConvolutionQuadrature) {
  for (const double eps : {0., 1e-2, 1.})
    for (const double c : {0.05, 1.}) expect_weights(make_scene("contact", {{"Q", 4}, {"eps", eps}, {"c", c}}), 16);
}

// M that the modes diagonalise without being a multiple of I: one fit a mode.
TEST(DualWeights, TakeAnyToeplitzM) {
  Scene scene = make_scene("contact", {{"Q", 4}});
  scene.M = Tridiagonal{Vector::Constant(4, -0.1), Vector::Constant(4, 0.3), Vector::Constant(4, -0.1)};
  scene.lcp_class = LcpClass::P;
  expect_weights(scene, 16);
}

Scene passive(std::uint32_t seed, Index m, Index n) {
  Random random(seed);
  Scene scene;
  scene.name = "passive " + std::to_string(seed);
  const Matrix A = random.matrix(m, m) - 2.0 * Matrix::Identity(m, m), B = random.matrix(m, n);
  scene.dynamics = DenseDynamics{A, B, B.transpose()};
  scene.M = Matrix(Matrix::Zero(n, n));
  scene.x0 = Vector::Zero(m);
  return scene;
}

TEST(DualWeights, OfDenseDynamicsAreThoseOfConvolutionQuadrature) {
  for (const std::uint32_t seed : {1u, 2u, 3u}) expect_weights(passive(seed, 4, 2), 16);
}

// Sparse dynamics: entries fitted to 1e-10 of the largest at each point.
TEST(DualWeights, OfSparseDynamicsAreThoseOfConvolutionQuadrature) {
  Scene scene = make_scene("contact", {{"Q", 4}, {"eps", 1e-2}});
  scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, 16);
  const DualChoice choice = dual_weights(p);
  ASSERT_TRUE(choice.weights) << choice.refusal;
  const auto& table = std::get<LagTable>(*choice.weights->weights);
  const std::vector<Matrix> expected = quadrature(oracle::write_out(scene), p.h, 16);
  const double size = expected[0].cwiseAbs().maxCoeff();
  for (Index d = 0; d <= 16; ++d) {
    Matrix scaled = Eigen::Map<const RowMatrix>(table.W.row(d).data(), 4, 4);
    if (d == 0) scaled += to_dense(choice.weights->P);
    const Matrix V = choice.weights->row_scale.asDiagonal() * scaled;
    EXPECT_LE((V - expected[std::size_t(d)]).cwiseAbs().maxCoeff(), 1e-9 * size) << d;
  }
}

// ---- two stages ----

// W_ab,d of V^(Delta(zeta)/h), Delta = (a + zeta/(1 - zeta) 1 b^T)^{-1}, by the same rule on |zeta| = rho.
std::vector<Matrix> stage_quadrature(const oracle::DenseScene& s, double h, Index J) {
  const Index L = 64 * J, n = s.M.rows(), m = s.A.rows();
  const double rho = std::pow(1e-8, 1 / double(L));
  const Matrix a{{5. / 12, -1. / 12}, {3. / 4, 1. / 4}}, I2 = Matrix::Identity(2, 2);
  const auto product = [](const ComplexMatrix& x, const ComplexMatrix& y) {
    ComplexMatrix all(x.rows() * y.rows(), x.cols() * y.cols());
    for (Index i = 0; i < x.rows(); ++i)
      for (Index j = 0; j < x.cols(); ++j) all.block(i * y.rows(), j * y.cols(), y.rows(), y.cols()) = x(i, j) * y;
    return all;
  };
  std::vector<Matrix> V(std::size_t(J) + 1, Matrix::Zero(2 * n, 2 * n));
  for (Index i = 0; i < L; ++i) {
    const double angle = 2 * std::numbers::pi * (double(i) + 0.5) / double(L);
    const Complex zeta = std::polar(rho, angle);
    ComplexMatrix inverse_delta = a.cast<Complex>();
    for (Index row = 0; row < 2; ++row)
      for (Index col = 0; col < 2; ++col) inverse_delta(row, col) += zeta / (1.0 - zeta) * a(1, col);
    const ComplexMatrix delta = inverse_delta.inverse() / h;
    const ComplexMatrix shifted =
        product(delta, Matrix::Identity(m, m).cast<Complex>()) - product(I2.cast<Complex>(), s.A.cast<Complex>());
    const ComplexMatrix K = product(I2.cast<Complex>(), s.N.cast<Complex>()) *
                            shifted.partialPivLu().solve(product(I2.cast<Complex>(), s.B.cast<Complex>()));
    const ComplexMatrix inverse = (product(I2.cast<Complex>(), s.M.cast<Complex>()) + K).inverse();
    for (Index d = 0; d <= J; ++d)
      V[std::size_t(d)] += (inverse * std::polar(std::pow(rho, -double(d)), -double(d) * angle)).real() / double(L);
  }
  return V;
}

TEST(DualWeights, OfTwoStagesAreThoseOfConvolutionQuadrature) {
  constexpr Index J = 16;
  for (const double eps : {0., 1e-2}) {
    Scene scene = make_scene("contact", {{"Q", 4}, {"eps", eps}});
    const auto backend = make_cpu_backend(1);
    const DiscreteProblem p = discretise(scene, *backend, J);
    const DualChoice choice = dual_weights(p, 2);
    ASSERT_TRUE(choice.weights) << choice.refusal;
    const std::vector<Matrix> expected = stage_quadrature(oracle::write_out(scene), p.h, J);
    const double size = expected[0].cwiseAbs().maxCoeff();
    const Matrix S = reference::sine_matrix(4);
    scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
    const DiscreteProblem sparse = discretise(scene, *backend, J);
    const DualChoice fitted = dual_weights(sparse, 2);
    ASSERT_TRUE(fitted.weights) << fitted.refusal;
    for (int a = 0; a < 2; ++a)
      for (int b = 0; b < 2; ++b) {
        const LagTable table = lag_table(Recurrence(part_of(*choice.weights->stage_weights, a, b)), J);
        const auto& entries = std::get<LagTable>(fitted.weights->stage_tables->parts[a][b]);
        for (Index d = 0; d <= J; ++d) {
          const Matrix V = S * table.W.row(d).asDiagonal() * S,
                       F = fitted.weights->row_scale.asDiagonal() *
                           Eigen::Map<const RowMatrix>(entries.W.row(d).data(), 4, 4),
                       exact = expected[std::size_t(d)].block(4 * a, 4 * b, 4, 4);
          EXPECT_LE((V - exact).cwiseAbs().maxCoeff(), 1e-10 * size) << a << b << ' ' << d;
          EXPECT_LE((F - exact).cwiseAbs().maxCoeff(), 1e-9 * size) << a << b << ' ' << d;
        }
      }
  }
}

// Symbols of order 1/2 and 1 without space.
TEST(DualWeights, ChooseTheDivisorThatContractsMost) {
  const ModeSymbols half = [](Complex z) -> ComplexVector { return ComplexVector::Constant(1, std::sqrt(z)); };
  const SweepChoice stages = choose_sweep(half, 1, 2, 3, 1), euler = choose_sweep(half, 1, 1, 3, 1);
  EXPECT_LT(stages.contraction, 0.2);
  EXPECT_LT(euler.contraction, 0.2);
  EXPECT_GT(euler.shift, 0.5);
  const ModeSymbols whole = [](Complex z) -> ComplexVector { return ComplexVector::Constant(1, z); };
  EXPECT_LT(choose_sweep(whole, 1, 2, 3, 1).contraction, 0.1) << "the defect of implicit Euler is none for V^ = z";
}

// Modes of a diffusive side, half a derivative in time and one in space: V_0 differs from mode to mode.
TEST(DualWeights, VaryTheDivisorsOfTheSweepsBefore) {
  const ModeSymbols V = [](Complex z) -> ComplexVector {
    ComplexVector values(12);
    for (Index l = 0; l < 12; ++l) values[l] = std::sqrt(z + std::pow(double(l + 1), 2.));
    return values;
  };
  for (const Index stages : {1, 2}) {
    const SweepChoice same = choose_sweep(V, 1, stages, 3, 1, false), varied = choose_sweep(V, 1, stages, 3, 1);
    EXPECT_LT(varied.contraction, 0.6 * same.contraction) << "what one divisor for all sweeps leaves, " << stages;
    const auto d = [&](const SweepChoice& choice, std::size_t i) {
      return stages == 2 ? choice.stages[i].second : choice.shifts[i];
    };
    ASSERT_EQ(stages == 2 ? varied.stages.size() : varied.shifts.size(), 4u);
    EXPECT_GT(d(varied, 0), d(varied, 1)) << "the largest first";
    EXPECT_GT(d(varied, 1), d(varied, 2));
    EXPECT_NEAR(d(varied, 0) + d(varied, 2), 2 * d(varied, 3), 1e-12 * d(varied, 3)) << "around the last one";
    for (std::size_t i = 0; i < 4; ++i) EXPECT_DOUBLE_EQ(d(same, i), same.shift);
  }
}

std::string refusal_of(const Scene& scene, Index J = 64) {
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, J);
  const DualChoice choice = dual_weights(p);
  EXPECT_FALSE(choice.weights) << scene.name;
  return choice.refusal;
}

TEST(DualWeights, AreRefusedWhereTheyDoNotExist) {
  Scene twice = passive(5, 4, 1);
  auto& d = get<DenseDynamics>(twice.dynamics);
  d.B = (Matrix(4, 2) << d.B, d.B).finished();
  d.N = d.B.transpose();
  twice.M = Matrix(Matrix::Zero(2, 2));
  EXPECT_NE(refusal_of(twice).find("repeat each other"), std::string::npos);
  Scene stop = passive(6, 2, 1);  // a mass on a spring: y acts on the acceleration
  stop.dynamics = DenseDynamics{Matrix{{0, 1}, {-1, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  EXPECT_NE(refusal_of(stop).find("second or a higher derivative"), std::string::npos);
  // N (zI - A)^{-1} B = (z - 5)/((z + 1)(z + 4)): V grows like e^{5t}.
  Scene growing = passive(7, 2, 1);
  growing.dynamics = DenseDynamics{Matrix{{-1, 0}, {0, -4}}, Matrix{{1}, {1}}, Matrix{{-2, 3}}};
  growing.T = 4;
  EXPECT_NE(refusal_of(growing).find("V grows"), std::string::npos);
  Scene local = make_scene("contact", {{"Q", 4}});
  local.M = Tridiagonal{Vector::Zero(4), Vector{{0, 1, 0, 1}}, Vector::Zero(4)};
  EXPECT_NE(refusal_of(local).find("do not diagonalise M"), std::string::npos);
}

// Heat in a network of 40 nodes: a path with chords, conductances from 0.1 to 10, a loss at every node. Contacts at the
// first nodes, `n` of them.
Scene network(std::uint32_t seed, Index n, double compliance) {
  constexpr Index m = 40;
  Random random(seed);
  std::vector<Eigen::Triplet<double>> entries;
  const auto join = [&](Index a, Index b) {
    const double joint = std::pow(10, random.vector(1)[0]);
    for (const Index end : {a, b}) entries.emplace_back(end, end, -joint);
    entries.emplace_back(a, b, joint);
    entries.emplace_back(b, a, joint);
  };
  for (Index i = 0; i + 1 < m; ++i) join(i, i + 1);
  for (Index i = 3; i + 9 < m; i += 5) join(i, i + 9);
  for (Index i = 0; i < m; ++i) entries.emplace_back(i, i, -0.2);
  SparseDynamics d{SparseMatrix(m, m), SparseMatrix(m, n), SparseMatrix(n, m)};
  d.A.setFromTriplets(entries.begin(), entries.end());
  for (Index i = 0; i < n; ++i) d.B.insert(4 * i, i) = 1.5, d.N.insert(i, 4 * i) = 1;
  Scene scene;
  scene.name = "network " + std::to_string(seed);
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
  scene.x0 = Vector::Zero(m);
  scene.T = 4;
  return scene;
}

TEST(DualWeights, ExistOrSayWhyOnRandomNetworks) {
  constexpr Index J = 32;
  for (std::uint32_t seed = 1; seed <= 6; ++seed) {
    // Passive: V exists, with and without a compliance.
    for (const double compliance : {0.0, 1e-2}) {
      const Scene scene = network(seed, 3, compliance);
      const auto backend = make_cpu_backend(1);
      const DiscreteProblem p = discretise(scene, *backend, J);
      const DualChoice choice = dual_weights(p);
      ASSERT_TRUE(choice.weights) << scene.name << ' ' << choice.refusal;
      const auto& table = std::get<LagTable>(*choice.weights->weights);
      const std::vector<Matrix> expected = quadrature(oracle::write_out(scene), p.h, J);
      for (const Index lag : {Index(0), Index(1), Index(5), J}) {
        Matrix scaled = Eigen::Map<const RowMatrix>(table.W.row(lag).data(), 3, 3);
        if (lag == 0) scaled += to_dense(choice.weights->P);
        const Matrix V = choice.weights->row_scale.asDiagonal() * scaled;
        EXPECT_LE((V - expected[std::size_t(lag)]).cwiseAbs().maxCoeff(), 1e-9 * expected[0].cwiseAbs().maxCoeff())
            << scene.name << ' ' << compliance << ' ' << lag;
      }
    }
    // One contact twice.
    Scene twice = network(seed, 3, 0);
    auto& repeated = get<SparseDynamics>(twice.dynamics);
    repeated.B.col(2) = repeated.B.col(1).eval();
    repeated.N = SparseMatrix(repeated.B.transpose());
    EXPECT_NE(refusal_of(twice, J).find("repeat each other"), std::string::npos) << refusal_of(twice, J);
    // y heats a node that no constraint sees.
    Scene apart = network(seed, 2, 0);
    auto& unseen = get<SparseDynamics>(apart.dynamics);
    unseen.N = SparseMatrix(2, 40);
    unseen.N.insert(0, 1) = unseen.N.insert(1, 6) = 1;
    EXPECT_NE(refusal_of(apart, J).find("second or a higher derivative"), std::string::npos) << apart.name;
    // Twice the lasting effect on another node is subtracted: K(0) < 0 < K at infinity, so M + K has a zero between.
    Scene grows = network(seed, 1, 0);
    auto& far = get<SparseDynamics>(grows.dynamics);
    const Vector lasting = -Matrix(far.A).lu().solve(Vector::Unit(40, 0));
    far.N.coeffRef(0, 12) = -2 * lasting[0] / lasting[12];
    grows.T = 100;
    const std::string why = refusal_of(grows, 256);
    EXPECT_TRUE(why.find("V grows") != std::string::npos || why.find("no short sum of decaying") != std::string::npos)
        << why;
  }
}

TEST(DualWeights, AreRefusedForAKroneckerSumWhoseInverseGrows) {
  Scene scene = make_scene("contact", {{"Q", 4}});
  auto& heat = get<KroneckerDynamics>(scene.dynamics);
  heat.n = Vector{{1, 0, 0, -20}};  // N (zI - A)^{-1} B is negative at 0 and positive at infinity
  EXPECT_NE(refusal_of(scene, 512).find("right half-plane"), std::string::npos);
  heat.n = Vector{{0, 1, 0, 0}};
  EXPECT_NE(refusal_of(scene).find("higher derivative"), std::string::npos);
}

// The sign that makes sweeps monotone (docs/dual.md): V_0 > 0, V_d <= 0, Σ V_d >= 0 in every mode.
TEST(DualWeights, OfContactHaveTheSignsOfTheTheorem) {
  const Scene scene = make_scene("contact", {{"Q", 15}});
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, 64);
  const DualChoice choice = dual_weights(p);
  ASSERT_TRUE(choice.weights) << choice.refusal;
  LagTable table = lag_table(std::get<Recurrence>(*choice.weights->weights), 64);
  const double rounding = 1e-12 * table.W.row(0).maxCoeff();
  EXPECT_GT(table.W.row(0).minCoeff(), 0);
  EXPECT_LE(table.W.bottomRows(64).maxCoeff(), rounding);
  EXPECT_GE(table.W.colwise().sum().minCoeff(), -64 * rounding);
}

}  // namespace
}  // namespace bromwich
