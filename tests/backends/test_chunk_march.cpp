// Contract of a scene in chunks of time on every backend (core/seam/chunk_march.hpp where it has that, threads of the
// host elsewhere): method shooting with steps by affine pieces against method march on the CPU.

#include "core/result/inner_options.hpp"
#include "core/solve/engines.hpp"
#include "core/solve/solve.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/run.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace bromwich {
namespace {

using reference::Random;

class BackendChunks : public BackendTest {
 protected:
  // Both take the same steps. Their states differ by the rounding at which chunks settle, 64 eps of the state for a
  // step, which the problems of the steps amplify by a condition of at most 1e3 here.
  static constexpr double same_steps = 1e-11;

  static double part_apart(const RowMatrix& a, const RowMatrix& b) {
    const double size = std::max(a.cwiseAbs().maxCoeff(), b.cwiseAbs().maxCoeff());
    return size > 0 ? distance(a, b) / size : distance(a, b);
  }

  void expect_march(const Scene& scene, Index steps, Index chunks, const std::string& what) {
    InnerOptions options{options_for(Method::shooting, steps)};
    options.states = StateSelection::all;
    options.chunks = chunks;
    const Result r = solve_valid(scene, *backend, options);
    Options as_march = options_for(Method::march, steps);
    as_march.states = StateSelection::all;
    const Result march = solve(scene, *make_cpu_backend(1), as_march);
    ASSERT_EQ(r.status, Status::solved) << what << ": " << r.reason;
    ASSERT_EQ(march.status, Status::solved) << what << ": " << march.reason;
    EXPECT_NE(r.kernel.find("affine pieces"), std::string::npos) << what << ": " << r.kernel;
    EXPECT_LE(part_apart(r.x, march.x), same_steps) << what;
    EXPECT_LE(part_apart(r.y, march.y), same_steps) << what;
    EXPECT_EQ(r.euler_steps, march.euler_steps) << what;
  }
};

// A is stable. M = P P^T + I leaves y continuous, the skew part of it does not.
Scene drawn_for_chunks(Index m, Index n, bool skew, unsigned seed) {
  Random random(seed);
  Scene scene;
  DenseDynamics d{random.matrix(m, m), random.matrix(m, n), random.matrix(n, m)};
  d.A -= 2 * std::sqrt(double(m)) * Matrix::Identity(m, m);
  d.N = d.B.transpose();
  scene.dynamics = d;
  const Matrix P = random.matrix(n, n);
  scene.M = Matrix(skew ? Matrix(P - P.transpose()) : Matrix(P * P.transpose() + Matrix::Identity(n, n)));
  scene.x0 = Vector::Zero(m);
  scene.T = 8;
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = 3 * std::sin(2 * t + double(i % 2));
  };
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::sin(t) * double(i % 2) + 0.1;
  };
  return scene;
}

TEST_P(BackendChunks, HaveTheStepsOfMarch) {
  for (const auto& [m, n] : {std::pair<Index, Index>(1, 1), {2, 2}, {3, 2}, {4, 4}, {8, 6}, {16, 16}})
    for (const Index chunks : {1, 7, 33})
      expect_march(drawn_for_chunks(m, n, false, unsigned(m)), 400, chunks,
                   "continuous " + std::to_string(m) + " x " + std::to_string(n));
  for (const auto& [m, n] : {std::pair<Index, Index>(1, 1), {2, 2}, {4, 3}, {7, 4}, {12, 4}})
    for (const Index chunks : {1, 7, 33})
      expect_march(drawn_for_chunks(m, n, true, unsigned(m)), 400, chunks,
                   "stages " + std::to_string(m) + " x " + std::to_string(n));
}

// A boost converter: steps in parts, solutions of least norm, a gate that jumps.
TEST_P(BackendChunks, HaveStepsInPartsAndSolutionsOfLeastNorm) {
  const double L = 1e-4, C = 1e-4, R = 10, period = 5e-5;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 0}, {0, -1 / (R * C)}}, Matrix{{0, -1 / L, 1 / L}, {1 / C, 0, 0}},
                                 Matrix{{0, 1}, {-1, 0}, {1, 0}}};
  scene.M = Matrix{{0, -1, 1}, {1, 0, 0}, {-1, 0, 0}};
  scene.x0 = Vector{{2, 16}};
  scene.T = 20 * period;
  scene.f = [=](double, Eigen::Ref<Vector> f) { f << 10 / L, 0; };
  scene.g = [=](double t, Eigen::Ref<Vector> g) {
    const double phase = t / period - std::floor(t / period);
    g << 0, (phase < 0.4 ? 100 : 0), 0;
  };
  for (int k = 0; k < 20; ++k)
    for (const double t : {k * period, (k + 0.4) * period})
      if (t > 0) scene.breakpoints.push_back(t);
  scene.breakpoints_are_all = true;
  expect_march(scene, 1000, 10, "boost");
}

// A bridge of six diodes between three phases: twelve unknowns a step, y known up to a common value.
TEST_P(BackendChunks, HaveBridgesWithLineInductances) {
  const double V = 325, L = 1e-3, C = 1e-3, R = 50;
  DenseDynamics d{Matrix::Zero(4, 4), Matrix::Zero(4, 6), Matrix::Zero(6, 4)};
  Matrix M = Matrix::Zero(6, 6);
  d.A(3, 3) = -1 / (R * C);
  for (Index i = 0; i < 3; ++i) {
    for (Index k = 0; k < 3; ++k) d.B(i, k) = (i == k ? -2 : 1) / (3 * L);
    d.B(3, 3 + i) = 1 / C;
    d.N(i, i) = -1;
    d.N(3 + i, 3) = 1;
    M(i, 3 + i) = 1;
    M(3 + i, i) = -1;
  }
  Scene scene;
  scene.dynamics = d;
  scene.M = M;
  scene.x0 = Vector::Zero(4);
  scene.T = 0.1;
  scene.f = [=](double t, Eigen::Ref<Vector> f) {
    for (Index k = 0; k < 3; ++k)
      f[k] = V / L * std::sin(100 * std::numbers::pi * t - 2 * std::numbers::pi * double(k) / 3);
    f[3] = 0;
  };
  expect_march(scene, 2000, 5, "three phases");
}

// A relay in a loop of relative degree three: steps in which the state jumps are taken by implicit Euler.
TEST_P(BackendChunks, TakeJumpsOfTheStateByImplicitEuler) {
  const Vector b{{1, -2, 1}};
  Scene scene;
  DenseDynamics d{Matrix{{-3.5, 1, 0}, {-627.5, 0, 1}, {-625, 0, 0}}, Matrix::Zero(3, 2), Matrix::Zero(2, 3)};
  d.B.col(0) = b;
  d.N(0, 0) = 1;
  scene.dynamics = d;
  scene.M = Matrix{{0, 1}, {-1, 0}};
  scene.x0 = Vector{{0, -0.001, -0.02}};
  scene.T = 10;
  scene.f = [=](double, Eigen::Ref<Vector> f) { f = -b; };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 2; };
  expect_march(scene, 4000, 6, "relay");
}

INSTANTIATE_TEST_SUITE_P(Contract, BackendChunks, testing::ValuesIn(backend_cases()), backend_case_name);

}  // namespace
}  // namespace bromwich
