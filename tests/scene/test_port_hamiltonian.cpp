// Port-Hamiltonian structure, the scenes made from it, and the energy balance of trajectories.

#include "catalogue/catalogue.hpp"
#include "core/goal/energy_balance.hpp"
#include "core/goal/indicators.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

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
  port.R = Matrix(Matrix::Identity(3, 3)).sparseView();  // 0 = -x_0 + x_1 - x_2: determines x_2
  std::string line = refusal([&] { port.validate(); });
  EXPECT_TRUE(line.starts_with("E: is singular, of rank 2 of 3, a differential-algebraic system of index 1")) << line;
  port.R = Matrix{{1, 0, 0}, {0, 1, 0}, {0, 0, 0}}.sparseView();  // 0 = -x_0 + x_1: a constraint with multiplier x_2
  line = refusal([&] { port.validate(); });
  EXPECT_TRUE(line.starts_with("E: is singular, of rank 2 of 3, a differential-algebraic system of index 2")) << line;
  port.J.setZero();  // x_2 is undetermined
  line = refusal([&] { port.validate(); });
  EXPECT_TRUE(line.starts_with("E: is singular, of rank 2 of 3, and det(s E - (J - R) Q) = 0 for all s")) << line;
}

/// m x m, s with neighbours: mass matrix of linear elements.
Matrix element_masses(Index m) {
  Matrix E = 4 * Matrix::Identity(m, m);
  for (Index i = 0; i + 1 < m; ++i) E(i, i + 1) = E(i + 1, i) = 1;
  return E;
}

// E of full rank in any units of its rows and columns, and rank-deficient E in any units.
TEST(PortHamiltonian, RegularityIsIndependentOfUnits) {
  for (const Index m : {6, 40, 600}) {
    PortHamiltonian port;
    SparseMatrix zero(m, m);
    port.J = port.R = zero;
    Vector units(m);
    for (Index i = 0; i < m; ++i) units[i] = std::pow(10, -12 + 24 * double(i % 7) / 6);  // 1e-12 to 1e12
    port.E = Matrix(units.asDiagonal() * element_masses(m) * units.asDiagonal()).sparseView();
    EXPECT_EQ(refusal([&] { port.validate(); }), "nothing was refused") << m;
    Matrix singular = element_masses(m);  // rows and columns 0 and 1 become equal
    singular.row(1) = singular.row(0);
    singular.col(1) = singular.col(0);
    port.E = Matrix(units.asDiagonal() * singular * units.asDiagonal()).sparseView();
    EXPECT_TRUE(refusal([&] { port.validate(); }).starts_with("E: is singular, of ")) << m;
  }
}

// Steps with E against steps with E^{-1} (J - R) Q: the same x, which satisfies E (x_i - x_{i-1}) = h (...).
TEST(PortHamiltonian, StepsWithEAreThoseWithItsInverse) {
  const Index m = 80;
  PortHamiltonian port = *make_scene("ladder", {{"n", 26}}).port;  // 79 states
  const Index k = port.states();
  ASSERT_LT(k, m);
  const Vector masses = port.E.diagonal();
  const Vector root = masses.cwiseSqrt();
  port.E = Matrix(root.asDiagonal() * element_masses(k) * root.asDiagonal()).sparseView();
  const double T = 5e-6;
  const PortSystem kept(port, T), written_out(port, T, PortSystem::Form::state_space);
  reference::Random random(8);
  const Vector x0 = random.vector(k), t = Vector::LinSpaced(33, 0, T);
  const auto backend = make_cpu_backend(1);
  const Matrix E(port.E), A(port.J - port.R), B(port.B);
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint}) {
    ASSERT_TRUE(kept.keeps_E(scheme));
    ASSERT_FALSE(written_out.keeps_E(scheme));
    RowMatrix x[2];
    for (const auto& [system, found] : {std::pair(&kept, &x[0]), std::pair(&written_out, &x[1])})
      *found = backend->step_chain(system->step_problem(scheme, group_steps(t)))
                   ->solve(step_sources(*system, scheme, t, x0));
    EXPECT_LE((x[0] - x[1]).cwiseAbs().maxCoeff(), 1e-12 * x[1].cwiseAbs().maxCoeff());
    const double theta = scheme == StepScheme::euler ? 1 : 0.5, h = T / 32;
    double worst = 0, size = 0;
    for (Index i = 0; i < 32; ++i) {
      const Vector a = x[0].row(i).transpose(), b = x[0].row(i + 1).transpose(), e = (1 - theta) * a + theta * b;
      const Vector source = B * std::sin(5e6 * std::numbers::pi * (t[i] + theta * h));
      worst = std::max(worst, (E * (b - a) - h * (A * e + source)).cwiseAbs().maxCoeff());
      size = std::max(size, (E.cwiseAbs() * (a.cwiseAbs() + b.cwiseAbs())).maxCoeff());
    }
    EXPECT_LE(worst, 1e-13 * size);
  }
}

TEST(PortHamiltonian, StructureIsIndependentOfUnits) {
  reference::Random random(3);
  PortHamiltonian port = random_port(random, 5);
  EXPECT_NO_THROW(port.validate());
  // Rows of R in units 1e9 apart: a negative part in small units is still detected.
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
  EXPECT_LE((E * get<DenseDynamics>(scene.dynamics).A - A).norm(), 1e-13 * A.norm() * E.norm());
  EXPECT_LE((E * Matrix(scene.F) - Matrix(port.B)).norm(), 1e-13 * E.norm() * Matrix(scene.F).norm());
  EXPECT_EQ(scene.constraints(), 0);

  const PortHamiltonian ladder = *make_scene("ladder", {{"n", 7}}).port;
  EXPECT_NO_THROW(ladder.validate());
  EXPECT_EQ(ladder.states(), 22);
  EXPECT_TRUE(holds<SparseDynamics>(make_scene("ladder", {{"n", 200}}).dynamics));
}

// March and implicit Euler solve scenes without constraints. e^{hA} is exact for u constant on both sides of a jump on
// the grid, apart from the mean of u in the step after the jump (u is sampled at time points).
TEST(PortHamiltonian, StepByStepMethodsTakeScenesWithoutConstraints) {
  const Scene scene = make_scene("ph-toy", {{"u", 0}});
  const auto& A = get<DenseDynamics>(scene.dynamics).A;
  const Vector expected = oracle::exponential(scene.T * A) * scene.x0;
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
  const Matrix F = Matrix(system.port().E.size() > 0 ? Matrix(system.port().E) : I).inverse() * Matrix(system.port().B);
  const auto input = [&](double at) {  // from the left at a jump
    Vector u(F.cols());
    system.port().u(at, u);
    return Vector(F * u);
  };
  const double aside = 1e-14 * t[t.size() - 1];
  RowMatrix x(t.size(), m);
  x.row(0) = x0.transpose();
  for (Index i = 1; i < t.size(); ++i) {
    const double h = t[i] - t[i - 1];
    const Vector before = x.row(i - 1).transpose();
    if (scheme == StepScheme::euler) {
      x.row(i) = (I - h * A).partialPivLu().solve(before + h * input(t[i] - aside)).transpose();
    } else if (scheme == StepScheme::midpoint) {
      const Vector middle = h * input((t[i] + t[i - 1]) / 2);
      x.row(i) = (I - h / 2 * A).partialPivLu().solve((I + h / 2 * A) * before + middle).transpose();
    } else {  // x' = A x + f0 + s (f1 - f0)/h, s' = 1: one exponential of the augmented system
      const Vector f0 = input(t[i - 1] + aside), f1 = input(t[i] - aside);
      Matrix augmented = Matrix::Zero(m + 2, m + 2);
      augmented.topLeftCorner(m, m) = A;
      augmented.block(0, m, m, 1) = (f1 - f0) / h;
      augmented.block(0, m + 1, m, 1) = f0;
      augmented(m, m + 1) = 1;
      Vector start(m + 2);
      start << before, 0, 1;
      x.row(i) = (oracle::exponential(h * augmented) * start).head(m).transpose();
    }
  }
  return x;
}

Vector random_grid(reference::Random& random, Index M, double T) {
  Vector t = Vector::Zero(M + 1);
  for (Index i = 1; i <= M; ++i) t[i] = t[i - 1] + random.uniform(0.1, 1);
  return t * (T / t[M]);
}

// With the quadrature of the scheme, v_i = -||x_i - x_{i-1}||^2/2 in the norm of Q^T E. Rounding: a few hundred
// operations on terms of the size of the energies and of power times T.
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

// Linear x, constant u: the midpoint rule violates the balance only by h/12 ||x_i - x_{i-1}||^2 in the norm of Q^T R Q.
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

// The library's steps and sources against dense formulas: u at the right end, at the midpoint, linear.
TEST(PortHamiltonian, StepsAreThoseByHand) {
  reference::Random random(9);
  const auto backend = make_cpu_backend(1);
  for (const PortHamiltonian& port : {random_port(random, 4), toy()})
    for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential}) {
      const PortSystem system(port, 8);
      const Vector t = random_grid(random, 23, 8), x0 = random.vector(port.states());
      const RowMatrix by_hand = steps_by_hand(system, scheme, t, x0);
      const RowMatrix x =
          backend->step_chain(system.step_problem(scheme, group_steps(t)))->solve(step_sources(system, scheme, t, x0));
      // u at 4 eps T from the points where the dense formulas use 1e-14 T; u is continuous there
      EXPECT_LE((x - by_hand).cwiseAbs().maxCoeff(), 1e-11 * by_hand.cwiseAbs().maxCoeff()) << to_string(scheme);
    }
}

// dH/dt = supplied - dissipated with x' from the system; the integral of the powers is the gain in energy.
TEST(EnergyBalance, PowersAreTheRateOfTheEnergy) {
  reference::Random random(10);
  const PortHamiltonian port = random_port(random, 4);
  const double T = 3;
  const PortSystem system(port, T);
  const Index M = 400;
  const Vector t = Vector::LinSpaced(M + 1, 0, T);
  const RowMatrix any = random.matrix(M + 1, 4);
  const PowerBalance p = power_balance({system, StepScheme::midpoint, t, any});
  const Matrix E(port.E), Q(port.Q);
  for (Index i = 0; i <= M; i += 7) {
    const Vector x = any.row(i).transpose();
    Vector u(2);
    port.u(t[i], u);
    const Vector slope = E.partialPivLu().solve(Matrix(port.J - port.R) * Q * x + Matrix(port.B) * u);
    const double rate = x.dot(Q.transpose() * E * slope), size = (Q * x).squaredNorm() * Matrix(port.R).norm() + 1;
    EXPECT_NEAR(p.supplied[i] - p.dissipated[i], rate, 1e-11 * size);
    EXPECT_GE(p.dissipated[i], -1e-13 * size);
  }
  // Trapezoidal rule: its error falls by 4 from one grid to the next.
  std::vector<double> gaps;
  for (const Index steps : {400, 800}) {
    const Vector times = Vector::LinSpaced(steps + 1, 0, T);
    const RowMatrix x = steps_by_hand(system, StepScheme::exponential, times, Vector{{1, -1, 0.5, 2}});
    const Trajectory path{system, StepScheme::exponential, times, x};
    const PowerBalance q = power_balance(path);
    const Vector power = q.supplied - q.dissipated;
    const Vector energy = energy_balance(path).energy;
    const double integral = T / double(steps) * (power.sum() - (power[0] + power[steps]) / 2);
    gaps.push_back(energy[steps] - energy[0] - integral);
  }
  EXPECT_NEAR(gaps[0] / gaps[1], 4, 0.2);
}

// The violation falls with the order of the reconstruction: the exponential scheme is exact for constant u, its cubic
// polynomials are not.
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
