// Port-Hamiltonian structure, the scenes made from it, and the energy balance of trajectories.

#include "core/energy_balance.hpp"
#include "core/scenes/catalogue.hpp"
#include "reference.hpp"
#include "refusal.hpp"
#include "run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

namespace bromwich {
namespace {

/// A random system with E, Q, one undamped direction and two ports.
PortHamiltonian random_port(reference::Random& random, Index m) {
  const Matrix Z = random.matrix(m, m), W = random.matrix(m, m), D = random.matrix(m, m - 1);
  const Matrix Q = random.matrix(m, m) + 3 * Matrix::Identity(m, m);
  const Matrix K = Z * Z.transpose() + Matrix::Identity(m, m);  // Q^T E
  PortHamiltonian port;
  port.Q = Q.sparseView();
  port.E = Matrix(Q.transpose().partialPivLu().solve(K)).sparseView();
  port.J = Matrix(W - W.transpose()).sparseView();
  port.R = Matrix(D * D.transpose()).sparseView();
  port.B = random.matrix(m, 2).sparseView();
  port.u = [](double t, Eigen::Ref<Vector> u) { u << std::sin(3 * t), std::exp(-t); };
  return port;
}

PortHamiltonian toy() { return *make_scene("ph-toy").port; }

TEST(PortHamiltonian, RefusesWhatHasNoStructure) {
  const auto spoiled = [](const std::function<void(PortHamiltonian&)>& spoil) {
    PortHamiltonian port = toy();
    spoil(port);
    return refusal([&] { port.validate(); });
  };
  const auto matrix = [](const Matrix& X) -> SparseMatrix { return X.sparseView(); };
  EXPECT_EQ(refusal([] { toy().validate(); }), "nothing was refused");
  const Matrix I = Matrix::Identity(3, 3);
  for (const auto& [line, begin] : std::vector<std::pair<std::string, std::string>>{
           {spoiled([&](auto& p) { p.J = SparseMatrix(); }), "J: has no rows"},
           {spoiled([&](auto& p) { p.J = matrix(I); }), "J: is not skew-symmetric: entry (0,0) is 1"},
           {spoiled([&](auto& p) { p.R = matrix(Matrix::Identity(2, 2)); }), "R: is 2 x 2; give 3 x 3"},
           {spoiled([&](auto& p) {
              p.R = matrix(Matrix{{1, 1, 0}, {0, 1, 0}, {0, 0, 0}});
            }),
            "R: is not symmetric"},
           {spoiled([&](auto& p) {
              p.R = matrix(Matrix{{1, 2, 0}, {2, 1, 0}, {0, 0, 0}});
            }),
            "R: is not positive semidefinite: it has a negative eigenvalue"},
           {spoiled([&](auto& p) { p.R = matrix(-I); }), "R: is not positive semidefinite: entry (0,0) is -1"},
           {spoiled([&](auto& p) {
              p.R = matrix(Matrix{{0, 1, 0}, {1, 5, 0}, {0, 0, 0}});
            }),
            "R: is not positive semidefinite: entry (1,0) is 1 beside a zero"},
           {spoiled([&](auto& p) {
              p.Q = matrix(Matrix{{1, 0, 0}, {1, 1, 0}, {0, 0, 1}});
            }),
            "Q: is not symmetric"},
           {spoiled([&](auto& p) { p.E = matrix(-I); }), "E: is not positive semidefinite"},
           {spoiled([&](auto& p) { p.B = matrix(Matrix::Ones(2, 1)); }), "B: has 2 rows"},
           {spoiled([&](auto& p) { p.B = SparseMatrix(); }), "B: is missing beside u"},
           {spoiled([&](auto& p) { p.R.coeffRef(0, 0) = NAN; }), "R: entry (0,0) is nan"}})
    EXPECT_TRUE(line.starts_with(begin)) << line << "\nshould begin with\n" << begin;
}

TEST(PortHamiltonian, SaysTheIndexOfASingularE) {
  PortHamiltonian port = toy();
  port.E = Matrix(Vector{{1, 1, 0}}.asDiagonal()).sparseView();
  port.R = Matrix(Matrix::Identity(3, 3)).sparseView();  // 0 = -x_0 + x_1 - x_2: solvable for x_2
  std::string line = refusal([&] { port.validate(); });
  EXPECT_TRUE(line.starts_with("E: is singular, of rank 2 of 3, a differential-algebraic system of index 1")) << line;
  port.R = Matrix{{1, 0, 0}, {0, 1, 0}, {0, 0, 0}}.sparseView();  // 0 = -x_0 + x_1: a constraint, x_2 its multiplier
  line = refusal([&] { port.validate(); });
  EXPECT_TRUE(line.starts_with("E: is singular, of rank 2 of 3, a differential-algebraic system of index 2")) << line;
}

TEST(PortHamiltonian, StructureIsIndependentOfUnits) {
  reference::Random random(3);
  PortHamiltonian port = random_port(random, 5);
  EXPECT_NO_THROW(port.validate());
  // Rows of R in units that are 1e9 apart: what is negative in small units is still seen.
  port.E = port.Q = SparseMatrix();
  port.R = Matrix(Vector{{1e9, 1, 1, 1, 1}}.asDiagonal()).sparseView();
  EXPECT_NO_THROW(port.validate());
  port.R = Matrix{{1e9, 0, 0, 0, 0}, {0, 1, 2, 0, 0}, {0, 2, 1, 0, 0}, {0, 0, 0, 1, 0}, {0, 0, 0, 0, 1}}.sparseView();
  EXPECT_TRUE(refusal([&] { port.validate(); }).starts_with("R: is not positive semidefinite"));
}

TEST(PortHamiltonian, SceneHasTheSameDynamics) {
  reference::Random random(4);
  const PortHamiltonian port = random_port(random, 5);
  const Scene scene = make_scene(port, random.vector(5), 2);
  scene.validate();
  const Matrix E(port.E), A = Matrix(port.J - port.R) * Matrix(port.Q);
  EXPECT_LE((E * std::get<DenseDynamics>(scene.dynamics).A - A).norm(), 1e-13 * A.norm() * E.norm());
  EXPECT_LE((E * Matrix(scene.F) - Matrix(port.B)).norm(), 1e-13 * E.norm() * Matrix(scene.F).norm());
  EXPECT_EQ(scene.constraints(), 0);

  const PortHamiltonian ladder = *make_scene("ladder", {{"n", 7}}).port;
  EXPECT_NO_THROW(ladder.validate());
  EXPECT_EQ(ladder.states(), 22);
  EXPECT_TRUE(std::holds_alternative<SparseDynamics>(make_scene("ladder", {{"n", 200}}).dynamics));
}

// March and implicit Euler solve scenes without constraints; e^{hA} with u constant on both sides of the jump, which
// lies on the grid, is exact but for the mean of u in the step behind the jump (u is sampled at time points).
TEST(PortHamiltonian, StepByStepMethodsTakeScenesWithoutConstraints) {
  const Scene scene = make_scene("ph-toy", {{"u", 0}});
  const auto& A = std::get<DenseDynamics>(scene.dynamics).A;
  const Vector expected = Matrix(scene.T * A).exp() * scene.x0;
  for (const Method method : {Method::march, Method::automatic, Method::euler}) {
    Options options = options_for(method, 400);
    options.states = StateSelection::all;
    const Result result = run(scene, options);
    EXPECT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_EQ(result.y.rows(), 401);
    EXPECT_EQ(result.y.cols(), 0);
    // Implicit Euler damps the mode of frequency sqrt(2) by e^{-h t} over [0, T]: 22 %.
    EXPECT_LE((result.x.row(400).transpose() - expected).norm(), method == Method::euler ? 0.5 : 1e-12);
  }
}

/// x of implicit Euler, midpoint or exponential steps from dense formulas, on any grid.
RowMatrix steps_by_hand(const PortSystem& system, StepScheme scheme, const Vector& t, const Vector& x0) {
  const Index m = system.states();
  const Matrix A(system.A()), I = Matrix::Identity(m, m);
  const RowMatrix d = step_sources(system, scheme, t, x0);
  RowMatrix x(t.size(), m);
  x.row(0) = x0.transpose();
  for (Index i = 1; i < t.size(); ++i) {
    const double h = t[i] - t[i - 1];
    const Vector before = x.row(i - 1).transpose(), source = d.row(i).transpose();
    if (scheme == StepScheme::euler)
      x.row(i) = (I - h * A).partialPivLu().solve(before + source).transpose();
    else if (scheme == StepScheme::midpoint)
      x.row(i) = (I - h / 2 * A).partialPivLu().solve((I + h / 2 * A) * before + source).transpose();
    else
      x.row(i) = (Matrix(h * A).exp() * before + source).transpose();
  }
  return x;
}

Vector random_grid(reference::Random& random, Index M, double T) {
  Vector t = Vector::Zero(M + 1);
  for (Index i = 1; i <= M; ++i) t[i] = t[i - 1] + random.uniform(0.1, 1);
  return t * (T / t[M]);
}

// With the quadrature of the scheme: v_i = -||x_i - x_{i-1}||^2/2 in the norm of Q^T E. Rounding: terms of the size of
// the energies and of the power times T, a few hundred operations each.
TEST(EnergyBalance, ViolationOfImplicitEulerIsHalfTheSquareOfTheStep) {
  reference::Random random(5);
  for (int repeat = 0; repeat < 4; ++repeat) {
    const double T = 3;
    const PortSystem system(random_port(random, 4), T);
    const Vector t = random_grid(random, 37, T);
    const RowMatrix x = steps_by_hand(system, StepScheme::euler, t, random.vector(4));
    const EnergyBalance b = energy_balance({system, StepScheme::euler, t, x});
    const double scale = b.energy.maxCoeff() + b.supplied.cwiseAbs().sum() + b.dissipated.sum();
    for (Index i = 0; i < 37; ++i) {
      const Vector step = (x.row(i + 1) - x.row(i)).transpose();
      EXPECT_NEAR(b.violation[i], -step.dot(system.energy_matrix() * step) / 2, 1e-13 * scale);
    }
  }
}

// Linear x, constant u: the balance of the midpoint rule misses h/12 ||x_i - x_{i-1}||^2 in the norm of Q^T R Q only.
TEST(EnergyBalance, ViolationOfMidpointIsThatOfDissipation) {
  reference::Random random(6);
  PortHamiltonian port = random_port(random, 4);
  port.u = [](double, Eigen::Ref<Vector> u) { u << 0.7, -0.4; };
  const double T = 3;
  const PortSystem system(port, T);
  const Vector t = random_grid(random, 29, T);
  const RowMatrix x = steps_by_hand(system, StepScheme::midpoint, t, random.vector(4));
  const EnergyBalance b = energy_balance({system, StepScheme::midpoint, t, x});
  const double scale = b.energy.maxCoeff() + b.supplied.cwiseAbs().sum() + b.dissipated.sum();
  for (Index i = 0; i < 29; ++i) {
    const Vector step = (x.row(i + 1) - x.row(i)).transpose();
    EXPECT_NEAR(b.violation[i], (t[i + 1] - t[i]) / 12 * step.dot(system.dissipation_matrix() * step), 1e-13 * scale);
  }
}

// What is violated falls with the order of the reconstruction: the exponential scheme is exact for constant u, its
// cubics are not.
TEST(EnergyBalance, ViolationFallsWithTheOrderOfTheScheme) {
  const PortSystem system(toy(), 10);
  for (const auto& [scheme, order] :
       {std::pair(StepScheme::euler, 1), std::pair(StepScheme::midpoint, 2), std::pair(StepScheme::exponential, 4)}) {
    double before = 0;
    for (const Index M : {80, 160, 320}) {
      const Vector t = Vector::LinSpaced(M + 1, 0, 10);
      const RowMatrix x = steps_by_hand(system, scheme, t, Vector{{1, 2, 1}});
      const double sum = energy_balance({system, scheme, t, x}).violation.cwiseAbs().sum();
      if (M == 320) {
        EXPECT_NEAR(std::log2(before / sum), order, 0.35) << to_string(scheme);
      }
      before = sum;
    }
  }
}

TEST(InputJumps, AreFoundBetweenSamples) {
  PortHamiltonian port = toy();
  port.jumps.clear();
  const auto found = input_jumps(port, 10);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_NEAR(found[0], 5, 1e-14);
  port.u = [](double t, Eigen::Ref<Vector> u) { u[0] = std::sin(9 * t) + (t > 2.03 ? 0.2 : 0) - (t >= 7.77 ? 1 : 0); };
  const auto two = input_jumps(port, 10);
  ASSERT_EQ(two.size(), 2u);
  EXPECT_NEAR(two[0], 2.03, 1e-14);
  EXPECT_NEAR(two[1], 7.77, 1e-14);
  port.u = [](double t, Eigen::Ref<Vector> u) { u[0] = std::sqrt(std::abs(t - 3.3)) + std::abs(t - 6); };  // kinks
  EXPECT_TRUE(input_jumps(port, 10).empty());
}

}  // namespace
}  // namespace bromwich
