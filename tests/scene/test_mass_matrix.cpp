// Scenes with a mass matrix E against the same scenes with explicit E^{-1} A, E^{-1} B and E^{-1} f.

#include "core/base/error.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace bromwich {
namespace {

// Diffusion on a line with contact at one end, by finite elements: E and A are tridiagonal, neither is diagonal.
SparseDynamics elements(Index m) {
  const double dx = 1.0 / double(m + 1);
  std::vector<Eigen::Triplet<double>> E, A;
  for (Index i = 0; i < m; ++i) {
    E.emplace_back(i, i, 4 * dx / 6);
    A.emplace_back(i, i, -2 / dx);
    for (const Index j : {i - 1, i + 1})
      if (j >= 0 && j < m) {
        E.emplace_back(i, j, dx / 6);
        A.emplace_back(i, j, 1 / dx);
      }
  }
  SparseDynamics d{SparseMatrix(m, m), SparseMatrix(m, 2), SparseMatrix(2, m), SparseMatrix(m, m)};
  d.E.setFromTriplets(E.begin(), E.end());
  d.A.setFromTriplets(A.begin(), A.end());
  d.B.insert(0, 0) = d.N.insert(0, 0) = 1;
  d.B.insert(m / 2, 1) = d.N.insert(1, m / 2) = 1;
  return d;
}

Scene mass_scene(const Dynamics& dynamics) {
  Scene scene;
  scene.dynamics = dynamics;
  scene.M = Matrix{{0.5, 0.1}, {0.1, 0.4}};
  const Index m = scene.states();
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = std::sin(3 * t + double(i)) / double(m);
  };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << 0.1 - 0.3 * std::sin(6 * t), 0.2 * std::cos(5 * t) - 0.05; };
  scene.x0 = Vector::LinSpaced(m, 0.1, 0.3);
  scene.T = 1;
  return scene;
}

// E^{-1} (..) with iterative refinement, by the oracle's own elimination.
DenseDynamics written_out(const Dynamics& dynamics) {
  const DenseDynamics d = to_dense(dynamics);
  const Eigen::FullPivLU<Matrix> lu(d.E);
  return {lu.solve(d.A), lu.solve(d.B), d.N};
}

Scene without_E(const Scene& scene) {
  Scene plain = scene;
  plain.dynamics = written_out(scene.dynamics);
  const Matrix E = to_dense(scene.dynamics).E;
  if (scene.f_entry == SourceEntry::state)
    plain.f = [f = scene.f, lu = Eigen::FullPivLU<Matrix>(E)](double t, Eigen::Ref<Vector> value) {
      Vector given(value.size());
      f(t, given);
      value = lu.solve(given);
    };
  if (scene.f_entry == SourceEntry::through_F)
    plain.F = SparseMatrix(Matrix(E.fullPivLu().solve(Matrix(scene.F))).sparseView(0, 0));
  return plain;
}

// A bound of the spectral norm that is its size for banded matrices and their inverses.
double norm_bound(const Matrix& X) {
  return std::sqrt(X.cwiseAbs().rowwise().sum().maxCoeff() * X.cwiseAbs().colwise().sum().maxCoeff());
}

double condition(const Matrix& E) { return norm_bound(E) * norm_bound(Eigen::PartialPivLU<Matrix>(E).inverse()); }

Result run_mass(const Scene& scene, Method method, Index steps = 160) {
  Options options;
  options.method = method;
  options.steps = steps;
  options.states = StateSelection::list;
  options.components = {0, scene.states() / 2, scene.states() - 1};
  return solve(scene, *make_cpu_backend(2), options);
}

void expect_same_mass(const Result& a, const Result& b, double tolerance) {
  ASSERT_EQ(a.status, Status::solved) << a.reason;
  ASSERT_EQ(b.status, Status::solved) << b.reason;
  EXPECT_LE((a.y - b.y).cwiseAbs().maxCoeff(), tolerance * std::max(1.0, b.y.cwiseAbs().maxCoeff())) << a.kernel;
  EXPECT_LE((a.x - b.x).cwiseAbs().maxCoeff(), tolerance * std::max(1.0, b.x.cwiseAbs().maxCoeff())) << a.kernel;
}

TEST(MassMatrix, DenseScenesAreThoseWithTheInverse) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  const auto draw = [&](Index r, Index c) { return Matrix(Matrix::NullaryExpr(r, c, [&] { return normal(random); })); };
  for (int k = 0; k < 8; ++k) {
    const Index m = 3 + k;
    const Matrix G = draw(m, m);
    DenseDynamics d{-(G * G.transpose() + 0.5 * Matrix::Identity(m, m)), draw(m, 2), {}, {}};
    d.N = d.B.transpose();
    d.E = Matrix::Identity(m, m) + 0.3 * draw(m, m);
    Scene scene = mass_scene(d);
    if (k % 3 == 1) {
      scene.f_entry = SourceEntry::through_F;
      scene.F = draw(m, m).sparseView();
    }
    if (k % 3 == 2) {
      scene.f_entry = SourceEntry::through_B;
      scene.f = [](double t, Eigen::Ref<Vector> phi) { phi << std::sin(t), std::cos(2 * t); };
    }
    const double tolerance = 1e-12 * condition(d.E);
    for (const Method method : {Method::march, Method::euler})
      expect_same_mass(run_mass(scene, method), run_mass(without_E(scene), method), tolerance);
  }
}

constexpr Index few_but_sparse = 520;  ///< scenes of up to 512 states are written out

/// max |min(y, w)| over the time points, with w from the y of a result, which is linear between them, and the sines: E
/// and A of `elements` share them as eigenvectors. Per mode E z' = -a E z + u: h phi_1 and h phi_2 of -a h by hand.
double complementarity_by_sines(const Scene& scene, const RowMatrix& y) {
  const SparseDynamics& d = get<SparseDynamics>(scene.dynamics);
  const Index m = scene.states(), J = y.rows() - 1;
  const double dx = 1.0 / double(m + 1), h = scene.T / double(J);
  Vector w = Vector::Zero(2), g(2);
  RowMatrix all = y * to_dense(scene.M).transpose();
  for (Index k = 1; k <= m; ++k) {
    const double cosine = std::cos(double(k) * std::numbers::pi * dx), mass = dx * (4 + 2 * cosine) / 6;
    const double a = 2 / dx * (1 - cosine) / mass, z = a * h, phi_1 = -std::expm1(-z) / z, phi_2 = (1 - phi_1) / z;
    Vector mode(m);
    for (Index i = 0; i < m; ++i) mode[i] = std::sqrt(2 * dx) * std::sin(double(k * (i + 1)) * std::numbers::pi * dx);
    const Vector in = d.B.transpose() * mode / mass, out = d.N * mode;
    double value = mode.dot(scene.x0);
    all.row(0) += value * out.transpose();
    for (Index j = 1; j <= J; ++j) {
      const double before = in.dot(y.row(j - 1)), after = in.dot(y.row(j));
      value = std::exp(-z) * value + h * (phi_1 * before + phi_2 * (after - before));
      all.row(j) += value * out.transpose();
    }
  }
  double worst = 0;
  for (Index j = 0; j <= J; ++j) {
    scene.g(h * double(j), g);
    w = all.row(j).transpose() + g;
    worst = std::max(worst, w.cwiseMin(y.row(j).transpose()).cwiseAbs().maxCoeff());
  }
  return worst;
}

TEST(MassMatrix, StaysSparse) {
  const SparseDynamics d = elements(few_but_sparse);
  Scene scene = mass_scene(d);
  const Result marched = run_mass(scene, Method::march);
  EXPECT_NE(marched.kernel.find("lag weights"), std::string::npos) << marched.kernel;
  expect_same_mass(run_mass(scene, Method::contour), marched, 1e-9);
  expect_same_mass(run_mass(scene, Method::euler), run_mass(without_E(scene), Method::euler),
                   1e-12 * condition(Matrix(d.E)));
  scene.f = {};  // samples of f would add an error of the grid
  for (const Method method : {Method::march, Method::contour}) {
    const Result r = run_mass(scene, method);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_GT(r.y.maxCoeff(), 0.1);
    EXPECT_LE(complementarity_by_sines(scene, r.y), 1e-9) << "the accepted error of contours, for w of size 1";
  }
}

// Blocks of two rows: E^{-1} A is sparse, too.
TEST(MassMatrix, NonsymmetricSparse) {
  SparseDynamics d = elements(few_but_sparse);
  std::vector<Eigen::Triplet<double>> E, inverse;
  for (Index i = 0; i < few_but_sparse; i += 2) {
    const double a = 1e-3 * (2 + std::sin(double(i))), b = 4e-4 * std::cos(double(i)), c = -3e-4, e = 1e-3;
    const double determinant = a * e - b * c;
    for (Index k = 0; k < 4; ++k) {
      E.emplace_back(i + k / 2, i + k % 2, std::array{a, b, c, e}[std::size_t(k)]);
      inverse.emplace_back(i + k / 2, i + k % 2, std::array{e, -b, -c, a}[std::size_t(k)] / determinant);
    }
  }
  d.E.setFromTriplets(E.begin(), E.end());
  SparseMatrix by(few_but_sparse, few_but_sparse);
  by.setFromTriplets(inverse.begin(), inverse.end());
  for (Index i = 0; i + 1 < few_but_sparse; ++i) {
    d.A.coeffRef(i, i + 1) += 3;
    d.A.coeffRef(i + 1, i) -= 3;
  }
  const Scene scene = mass_scene(d);
  Scene divided = scene;
  divided.dynamics = SparseDynamics{SparseMatrix(by * d.A), SparseMatrix(by * d.B), d.N, {}};
  divided.f = [f = scene.f, by](double t, Eigen::Ref<Vector> value) {
    f(t, value);
    value = (by * value).eval();
  };
  for (const Method method : {Method::march, Method::euler})
    expect_same_mass(run_mass(scene, method), run_mass(divided, method), 1e-12 * condition(Matrix(d.E)) + 1e-9);
}

TEST(MassMatrix, DiagonalIsDividedOut) {
  SparseDynamics d = elements(700);
  const SparseMatrix full = d.E;
  Vector diagonal(700);
  for (Index i = 0; i < 700; ++i) diagonal[i] = full.row(i).sum() * (1 + 0.5 * std::sin(double(i)));
  d.E = SparseMatrix(diagonal.asDiagonal());
  const Scene scene = mass_scene(d);
  ASSERT_TRUE(without_mass(scene));
  EXPECT_FALSE(without_mass(scene)->dynamics->has_mass());
  Scene divided = scene;
  const Vector shares = diagonal.cwiseInverse();
  divided.dynamics =
      SparseDynamics{SparseMatrix(shares.asDiagonal() * d.A), SparseMatrix(shares.asDiagonal() * d.B), d.N, {}};
  divided.f = [f = scene.f, shares](double t, Eigen::Ref<Vector> value) {
    f(t, value);
    value.array() *= shares.array();
  };
  expect_same_mass(run_mass(scene, Method::march), run_mass(divided, Method::march), 1e-9);
}

TEST(MassMatrix, GalerkinAndSmallSparseScenes) {
  const Scene scene = mass_scene(elements(40));
  for (const Method method : {Method::galerkin, Method::march, Method::automatic})
    expect_same_mass(run_mass(scene, method), run_mass(without_E(scene), method), 1e-11);
}

TEST(MassMatrix, UnitsDoNotMatter) {
  SparseDynamics d = elements(600);
  Scene scene = mass_scene(d);
  const Result expected = run_mass(scene, Method::march);
  d.E *= 1e7;  // equations in another unit
  d.A *= 1e7;
  d.B *= 1e7;
  scene.dynamics = d;
  scene.f = [f = scene.f](double t, Eigen::Ref<Vector> value) {
    f(t, value);
    value *= 1e7;
  };
  expect_same_mass(run_mass(scene, Method::march), expected, 1e-9);
}

TEST(MassMatrix, StatesAfterTheSolveKnowIt) {
  const Scene scene = mass_scene(DenseDynamics{-Matrix::Identity(3, 3), Matrix{{1, 0}, {0, 1}, {1, 0}},
                                               Matrix{{1, 0, 0}, {0, 1, 0}}, Matrix{{2, 1, 0}, {0, 3, 0}, {1, 0, 1}}});
  const auto backend = make_cpu_backend(1);
  Options options;
  options.steps = 80;
  options.method = Method::march;
  options.states = StateSelection::all;
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const double tolerance = 1e-12 * condition(to_dense(scene.dynamics).E);
  EXPECT_LE((states_at(scene, *backend, result, {40}) - result.x.row(40).transpose()).cwiseAbs().maxCoeff(), tolerance);
  const Result between = at_times(scene, *backend, result, {0.5, 0.50625}),
               expected = at_times(without_E(scene), *backend, result, {0.5, 0.50625});
  EXPECT_LE((between.x - expected.x).cwiseAbs().maxCoeff(), tolerance);
}

TEST(MassMatrix, SingularOnesAreUnsupported) {
  SparseDynamics d = elements(600);
  d.E.coeffRef(17, 17) = 0;
  for (const Index j : {16, 18}) d.E.coeffRef(17, j) = d.E.coeffRef(j, 17) = 0;
  const Result sparse = run_mass(mass_scene(d), Method::march);
  EXPECT_EQ(sparse.status, Status::unsupported);
  EXPECT_NE(sparse.reason.find("E is singular"), std::string::npos);
  const Result dense =
      run_mass(mass_scene(DenseDynamics{-Matrix::Identity(3, 3), Matrix::Identity(3, 2), Matrix::Identity(2, 3),
                                        Matrix{{1, 2, 0}, {2, 4, 0}, {0, 0, 1}}}),
               Method::automatic);
  EXPECT_EQ(dense.status, Status::unsupported);
}

TEST(MassMatrix, WrongShapesAreNamed) {
  SparseDynamics d = elements(10);
  d.E = SparseMatrix(9, 10);
  EXPECT_EQ(refusal([&] { mass_scene(d).validate(); }).rfind("E:", 0), 0u);
}

}  // namespace
}  // namespace bromwich
