// The Galerkin method against a dense matrix of the same discrete problem, integrated by the oracle's quadrature. Free
// unknowns are eliminated from the whole matrix at once, and the complementarity problem is solved by Lemke's method.

#include "catalogue/catalogue.hpp"
#include "core/galerkin/free.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/lemke.hpp"
#include "core/numerics/two_point.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle_galerkin.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {
namespace {

using reference::Random;

enum class EndConditions { initial, separated, coupled, periodic };

/// m = 3, n = 2; quadratic f and g; M strictly dominant, dynamics weak enough for a unique solution.
Scene quadratic_scene(std::uint32_t seed, EndConditions ends) {
  Random random(seed);
  const Index m = 3, n = 2;
  const Matrix f = random.matrix(m, 3);  // coefficients of 1, t, t^2
  Matrix g = random.matrix(n, 3);
  g.col(0) *= 2;
  Scene scene;
  scene.dynamics = DenseDynamics{2 * random.matrix(m, m), random.matrix(m, n), 0.4 * random.matrix(n, m)};
  scene.M = Matrix(random.dominant(n) + Matrix::Identity(n, n));
  scene.f = [f](double t, Eigen::Ref<Vector> value) { value = f * Eigen::Vector3d(1, t, t * t); };
  scene.g = [g](double t, Eigen::Ref<Vector> value) { value = g * Eigen::Vector3d(1, t, t * t); };
  scene.T = 1.5;
  const Matrix I = Matrix::Identity(m, m), none = Matrix::Zero(m, m);
  if (ends == EndConditions::initial) {
    scene.x0 = random.vector(m);
    return scene;
  }
  BoundaryCondition c{none, none, random.vector(m)};
  if (ends == EndConditions::separated) {
    c.E0.row(0) = random.matrix(1, m);
    c.ET.bottomRows(2) = random.matrix(2, m);
  } else if (ends == EndConditions::coupled) {
    c.E0 = I + 0.3 * random.matrix(m, m);
    c.ET = random.matrix(m, m);
  } else {
    c.E0 = I;
    c.ET = -I;
    c.b.setZero();
  }
  scene.boundary = c;
  return scene;
}

/// w = L z + q over all intervals, boundary condition included, by quadrature.
struct Assembled {
  Matrix L;
  Vector q;
};

Assembled assemble(const Scene& scene, Index N) {
  const oracle::GalerkinSystem system = oracle::galerkin_system(scene, N);
  return {system.matrix, system.q};
}

/// z of the mixed problem, free unknowns eliminated from all intervals at once.
Vector pivoted(const Assembled& a, const std::vector<Index>& free_rows, Index n) {
  std::vector<Index> f, c;
  for (Index i = 0; i < a.q.size(); ++i)
    (std::count(free_rows.begin(), free_rows.end(), i % n) > 0 ? f : c).push_back(i);
  Vector z = Vector::Zero(a.q.size());
  if (f.empty()) {
    const LemkeOutcome found = lemke(a.L, a.q);
    EXPECT_TRUE(found.solved);
    return found.solved ? found.y : z;
  }
  const Eigen::FullPivLU<Matrix> lu(a.L(f, f));
  if (c.empty()) {
    z(f) = -lu.solve(a.q(f));
    return z;
  }
  const LemkeOutcome found = lemke(a.L(c, c) - a.L(c, f) * lu.solve(a.L(f, c)), a.q(c) - a.L(c, f) * lu.solve(a.q(f)));
  EXPECT_TRUE(found.solved);
  if (!found.solved) return z;
  z(c) = found.y;
  z(f) = -lu.solve(a.q(f) + a.L(f, c) * found.y);
  return z;
}

RowMatrix rows_of(const Vector& z, Index N) { return Eigen::Map<const RowMatrix>(z.data(), N, z.size() / N); }

// Sums of 2 n N = 256 terms of size 10, and a condition of the boundary problems of about 10^2: 1e-16 * 1e4 and a
// margin.
constexpr double same_assembled = 1e-11;

class GalerkinDense : public testing::TestWithParam<EndConditions> {};
INSTANTIATE_TEST_SUITE_P(Conditions, GalerkinDense,
                         testing::Values(EndConditions::initial, EndConditions::separated, EndConditions::coupled,
                                         EndConditions::periodic));

TEST_P(GalerkinDense, OperatorAgreesWithItsMatrix) {
  Random random(5);
  for (const Index N : {1, 2, 7, 16}) {
    const Scene scene = quadratic_scene(3, GetParam());
    const Assembled a = assemble(scene, N);
    const GalerkinProblem p = galerkin_problem(scene, N);
    const Vector z = random.vector(a.q.size());
    const RowMatrix w = galerkin_slack(p, rows_of(z, N), galerkin_states(p, rows_of(z, N)));
    EXPECT_LE((w - rows_of(a.L * z + a.q, N)).cwiseAbs().maxCoeff(), same_assembled) << N;
    EXPECT_LE((apply_galerkin(p, rows_of(z, N)) - rows_of(a.L * z, N)).cwiseAbs().maxCoeff(), same_assembled) << N;
  }
}

TEST_P(GalerkinDense, SolutionsAgree) {
  Index active = 0, inactive = 0;
  for (const std::uint32_t seed : {1u, 2u, 3u})
    for (const Index N : {1, 5, 64}) {
      Scene scene = quadratic_scene(seed, GetParam());
      const Assembled assembled = assemble(scene, N);
      for (const std::vector<Index>& free_rows : {std::vector<Index>{}, {0}, {1}, {0, 1}}) {
        scene.free_rows = free_rows;
        const RowMatrix expected = rows_of(pivoted(assembled, free_rows, 2), N);
        const Result r = run(scene, options_for(Method::galerkin, N));
        ASSERT_EQ(r.status, Status::solved) << r.reason;
        EXPECT_LE(distance(r.y_left, expected.leftCols(2)), same_assembled) << seed << ' ' << N;
        EXPECT_LE(distance(r.y.bottomRows(N), expected.rightCols(2)), same_assembled) << seed << ' ' << N;
        EXPECT_EQ(r.y.row(0), r.y_left.row(0));
        EXPECT_LE(r.residual, same_assembled);
        active += (expected.array() != 0).count();
        inactive += (expected.array() == 0).count();
      }
    }
  EXPECT_GT(active, 500);
  EXPECT_GT(inactive, 500);
}

// All solvers of the reduced problem find the same solution.
TEST_P(GalerkinDense, SolversAgree) {
  const auto backend = make_cpu_backend(2);
  for (const std::uint32_t seed : {1u, 4u}) {
    const Index N = 48;
    const Scene scene = quadratic_scene(seed, GetParam());
    const GalerkinProblem p = galerkin_problem(scene, N);
    const GalerkinSolution exact = exchange_active_sets(p, *backend, {});
    ASSERT_EQ(exact.status, Status::solved) << exact.reason;
    const RowMatrix far = RowMatrix::Constant(N, p.unknowns(), 10);
    const GalerkinSolution damped = damped_newton(p, *backend, {}, far), pivots = pivot_assembled(p, {});
    for (const GalerkinSolution* other : {&damped, &pivots}) {
      ASSERT_EQ(other->status, Status::solved) << other->reason;
      EXPECT_LE(distance(other->z, exact.z), same_assembled) << other->how;
    }
    if (GetParam() == EndConditions::initial) {
      EXPECT_LE(distance(march_galerkin(p, *backend, {}).z, exact.z), same_assembled);
    }
  }
}

// The iteration on every backend, to its tolerance on z.
class GalerkinIteration : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(Contract, GalerkinIteration, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(GalerkinIteration, FindsTheSolution) {
  Scene scene = quadratic_scene(6, EndConditions::initial);
  auto& d = get<DenseDynamics>(scene.dynamics);
  d.A -= 4 * Matrix::Identity(3, 3);
  d.N *= 0.5;
  for (const Index N : {1, 33, 200}) {
    const GalerkinProblem p = galerkin_problem(scene, N);
    const GalerkinSolution exact = exchange_active_sets(p, *backend, {}), sweeps = iterate_galerkin(p, *backend, {});
    ASSERT_EQ(exact.status, Status::solved) << exact.reason;
    ASSERT_EQ(sweeps.status, Status::solved) << sweeps.reason;
    EXPECT_LE(distance(sweeps.z, exact.z), same_problem) << N;
  }
}

TEST_P(GalerkinIteration, MarchingAgreesOnEveryBackend) {
  const Scene scene = quadratic_scene(8, EndConditions::initial);
  const GalerkinProblem p = galerkin_problem(scene, 77);
  const GalerkinSolution marched = march_galerkin(p, *backend, {});
  ASSERT_EQ(marched.status, Status::solved) << marched.reason;
  EXPECT_LE(distance(marched.z, exchange_active_sets(p, *backend, {}).z), same_assembled);
}

// The number of sweeps must not grow with the grid.
TEST_P(GalerkinIteration, SweepsDoNotGrowWithTheGrid) {
  const Scene scene = make_scene("bridge", {});
  Index fewest = most_exchanges, most = 0;
  for (const Index N : {48, 192, 768}) {
    const GalerkinProblem p = galerkin_problem(scene, N);
    const GalerkinSolution sweeps = iterate_galerkin(p, *backend, {}),
                           exchanged = exchange_active_sets(p, *backend, {});
    ASSERT_EQ(sweeps.status, Status::solved) << sweeps.reason;
    ASSERT_EQ(exchanged.status, Status::solved) << exchanged.reason;
    EXPECT_LE(distance(sweeps.z, exchanged.z), same_problem * sweeps.z.cwiseAbs().maxCoeff()) << N;
    fewest = std::min(fewest, sweeps.iterations);
    most = std::max(most, sweeps.iterations);
  }
  EXPECT_LE(most, 40);
  EXPECT_LE(most - fewest, 2);
}

// Quadratic sources are integrated exactly on both grids.
TEST(GalerkinGrids, HalfAsManyIntervalsWithoutSamples) {
  for (const EndConditions ends : {EndConditions::initial, EndConditions::periodic}) {
    const Scene scene = quadratic_scene(3, ends);
    const GalerkinProblem sampled = galerkin_problem(scene, 7),
                          found = coarser_problem(scene, galerkin_problem(scene, 14));
    EXPECT_LE(distance(found.forcing, sampled.forcing), 1e-13 * std::max(1.0, sampled.forcing.cwiseAbs().maxCoeff()));
    EXPECT_LE(distance(found.q, sampled.q), 1e-13 * std::max(1.0, sampled.q.cwiseAbs().maxCoeff()));
    EXPECT_LE((found.t - sampled.t).cwiseAbs().maxCoeff(), 1e-15);
    EXPECT_LE((found.first_step().D - sampled.first_step().D).cwiseAbs().maxCoeff(), 1e-14);
  }
}

// A chain with modes e^{15 k} and e^{-15 k} over 80 steps: e^{1200} is never formed, each end fixes one mode.
TEST(TwoPoint, BoundaryLayers) {
  const Matrix V{{1, 1}, {1, 2}};
  const Matrix P = V * Eigen::Vector2d(std::exp(15), std::exp(-15)).asDiagonal() * V.inverse();
  const std::vector<const Matrix*> steps(80, &P);
  const BoundaryCondition ends{Matrix{{0, 1}, {0, 0}}, Matrix{{0, 0}, {1, 0}}, Vector{{3, 5}}};
  const RowMatrix x = solve_two_point(steps, RowMatrix::Zero(80, 2), ends, 1e-10);
  ASSERT_EQ(x.rows(), 81);
  // Only the decaying mode (1, 2) remains at 0, the growing one (1, 1) at T. The entries of P have the error eps e^15 =
  // 1e-9, which replaces the decaying factor, and a state follows from its neighbour with no better accuracy.
  EXPECT_NEAR(x(0, 0), 1.5, 1e-12);
  EXPECT_NEAR(x(0, 1), 3, 1e-12);
  EXPECT_NEAR(x(80, 0), 5, 1e-12);
  EXPECT_NEAR(x(80, 1), 5, 16 * epsilon * std::exp(15));
  EXPECT_LE(x.middleRows(5, 60).cwiseAbs().maxCoeff(), 16 * epsilon * std::exp(15));
}

// Three methods for the same states.
TEST(TwoPoint, BlocksSegmentsAndKrylovAgree) {
  Random random(9);
  for (const Index m : {1, 4, 70}) {
    const Index N = 30;
    std::vector<Matrix> steps;
    std::vector<const Matrix*> P;
    for (Index k = 0; k < N; ++k) steps.push_back(0.5 / std::sqrt(double(m)) * random.matrix(m, m));
    for (const Matrix& step : steps) P.push_back(&step);
    const RowMatrix p = random.matrix(N, m);
    const BoundaryCondition ends{Matrix::Identity(m, m), -Matrix::Identity(m, m), random.vector(m)};
    const RowMatrix segments = solve_two_point_by_segments(P, p, ends, 1e-12);
    ASSERT_EQ(segments.rows(), N + 1) << m;
    if (m <= 4) {  // its rounding bound grows with the absolute values
      for (const Index length : {1, 7, 30, 128})
        EXPECT_LE(distance(solve_two_point_in_blocks(P, p, ends, 1e-12, length), segments), 1e-12)
            << m << ' ' << length;
    }
    EXPECT_LE(distance(solve_two_point_krylov(P, p, ends), segments), 1e-12) << m;
    for (Index k = 0; k < N; ++k)
      EXPECT_LE(
          (steps[std::size_t(k)] * segments.row(k).transpose() + p.row(k).transpose() - segments.row(k + 1).transpose())
              .norm(),
          1e-12);
  }
  // Growth by 2^60 within a block: it refuses.
  const Matrix twice = Matrix{{2, 1}, {0, 0.5}};
  const std::vector<const Matrix*> P(60, &twice);
  const BoundaryCondition ends{Matrix{{0, 1}, {0, 0}}, Matrix{{0, 0}, {1, 0}}, Vector{{3, 5}}};
  EXPECT_EQ(solve_two_point_in_blocks(P, RowMatrix::Zero(60, 2), ends, 1e-12, 60).rows(), 0);
  EXPECT_EQ(solve_two_point_in_blocks(P, RowMatrix::Zero(60, 2), ends, 1e-12, 8).rows(), 61);
  EXPECT_EQ(solve_two_point_by_segments(P, RowMatrix::Zero(60, 2), ends, 1e-12).rows(), 61);
}

TEST(TwoPoint, SegmentsOfAnyLength) {
  Random random(2);
  const Matrix P = random.matrix(3, 3);
  const Vector p = random.vector(3), x0 = random.vector(3);
  Vector x = x0;
  for (const Index N : {1, 2, 3, 6, 13}) {
    x = x0;
    for (Index k = 0; k < N; ++k) x = (P * x + p).eval();
    const Segment all = repeated(P, p, N);
    EXPECT_LE((all.V * x0 + all.U * x - all.r).norm(), 1e-13 * (1 + x.norm())) << N;
    const BoundaryCondition start{Matrix::Identity(3, 3), Matrix::Zero(3, 3), x0};
    EXPECT_LE((solve_ends(all, start).last - x).norm(), 1e-11 * (1 + x.norm())) << N;
  }
}

}  // namespace
}  // namespace bromwich
