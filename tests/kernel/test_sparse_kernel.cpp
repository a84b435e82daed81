// Kernels of large sparse A, at sizes that allow dense references, against the oracle's matrix functions.

#include "core/base/error.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/sparse_kernel.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/dense_twin.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/sparse_grids.hpp"

#include <Eigen/Dense>

#include <numbers>

namespace bromwich {
namespace {

using reference::Random;
/// A scene on a sparse A with n constraints on some states, x0 and sources of size 1.
Scene scene_on(const SparseMatrix& A, Index n, SourceEntry entry, Index sources, double T) {
  const Index m = A.rows();
  Random random{std::uint32_t(m + n)};
  Triplets B, N, F;
  for (Index i = 0; i < n; ++i) {
    B.emplace_back(i * (m / n), i, 1.0);
    N.emplace_back(i, i * (m / n), 1.0);
    N.emplace_back(i, (i * (m / n) + m / 3) % m, 0.5);
  }
  for (Index i = 0; i < m; ++i)
    for (Index j = 0; j < sources; ++j) F.emplace_back(i, j, random.uniform());
  Scene scene;
  scene.name = "sparse";
  scene.dynamics = SparseDynamics{A, assemble(m, n, B), assemble(n, m, N)};
  scene.M = Matrix(random.dominant(n) + Matrix::Identity(n, n));
  scene.lcp_class = LcpClass::P;
  scene.x0 = random.vector(m);
  scene.g = [](double t, Eigen::Ref<Vector> value) { value.setConstant(std::sin(4 * t) - 0.5); };
  scene.T = T;
  if (sources == 0 && entry == SourceEntry::through_F) return scene;
  scene.f_entry = entry;
  scene.f = [](double t, Eigen::Ref<Vector> value) {
    for (Index i = 0; i < value.size(); ++i) value[i] = std::cos(3 * t + double(i));
  };
  if (entry == SourceEntry::through_F) scene.F = assemble(m, sources, F);
  return scene;
}

double weight_distance(const LagTable& table, const oracle::Weights& exact) {
  double worst = 0, largest = 0;
  for (std::size_t d = 0; d < exact.W.size(); ++d) {
    const Eigen::Map<const RowMatrix> W(table.W.row(Index(d)).data(), table.outputs, table.inputs);
    const Eigen::Map<const RowMatrix> S(table.S.row(Index(d)).data(), table.outputs, table.inputs);
    worst = std::max({worst, (W - exact.W[d]).cwiseAbs().maxCoeff(), (S - exact.S[d]).cwiseAbs().maxCoeff()});
    largest = std::max(largest, exact.W[d].cwiseAbs().maxCoeff());
  }
  return worst / largest;
}

struct KernelCase {
  const char* name;
  Scene scene;
  Index J;
};

std::vector<KernelCase> kernel_cases() {
  const SourceEntry F = SourceEntry::through_F;
  return {{"heat", scene_on(grid(8, 9), 3, F, 0, 1), 120},
          {"one step", scene_on(grid(8, 9), 3, F, 2, 0.01), 1},
          {"two steps", scene_on(grid(8, 9), 3, F, 2, 0.02), 2},
          {"six steps", scene_on(grid(6, 5), 1, F, 1, 0.1), 6},
          {"through F", scene_on(grid(10, 4), 2, F, 3, 1), 64},
          {"through B", scene_on(grid(10, 4), 2, SourceEntry::through_B, 0, 1), 64},
          {"states", scene_on(grid(6, 5), 2, SourceEntry::state, 0, 1), 40},
          {"wind", scene_on(grid(10, 10, 1, 8), 3, F, 2, 1), 100},
          {"strong wind", scene_on(grid(14, 14, 0.05, 1), 2, F, 1, 2), 100},
          {"zero eigenvalue", scene_on(assemble(40, 40, {{1, 1, -1.0}, {2, 2, -50.0}}), 2, F, 1, 1), 50},
          {"unstable", scene_on(grid(8, 8, 0.1, 0, 4), 2, F, 1, 1), 100}};
}

TEST(SparseKernel, AgreesWithTheOracle) {
  const auto backend = make_cpu_backend(2);
  for (const KernelCase& c : kernel_cases()) {
    const DiscreteProblem p = discretise(c.scene, *backend, c.J);
    const std::vector<Index> components{0, c.scene.states() - 1};
    const auto kernel = sparse_kernel(p, components);
    ASSERT_TRUE(kernel) << c.name;
    EXPECT_LE(kernel->error, accepted_contour_error) << c.name;
    EXPECT_FALSE(kernel->description.empty());
    EXPECT_GE(kernel->bytes, sizeof(double) * std::size_t(kernel->weights.W.size()));

    oracle::DenseScene exact = oracle::write_out(dense_twin(c.scene));
    // Contours are accurate to 1e-14, with a factor e^{sigma T} <= 3000 if shifted; weights relative to the largest.
    const double tolerance = 1e-10;
    EXPECT_LE(weight_distance(kernel->weights, oracle::weights(exact, p.h, c.J)), tolerance) << c.name;
    const RowMatrix x = oracle::states_of(exact, RowMatrix::Zero(c.J + 1, c.scene.constraints()));
    const double size = x.cwiseAbs().maxCoeff();
    EXPECT_LE(distance(kernel->free, x * exact.N.transpose()), tolerance * size) << c.name;
    RowMatrix seen(c.J + 1, 2);
    seen << x.col(0), x.col(c.scene.states() - 1);
    EXPECT_LE(distance(kernel->seen_free, seen), tolerance * size) << c.name;
    exact.N = Matrix::Zero(2, c.scene.states());
    exact.N(0, 0) = exact.N(1, c.scene.states() - 1) = 1;
    EXPECT_LE(weight_distance(kernel->seen, oracle::weights(exact, p.h, c.J)), tolerance) << c.name;
  }
}

TEST(SparseKernel, IsNeverWrongWhereItAnswers) {
  const auto backend = make_cpu_backend(2);
  std::vector<KernelCase> cases;
  // Growth from e^3 to e^60 beside stiff decay, visible to the estimates (symmetric A) or hidden by a wind.
  for (const double growth : {3.0, 10.0, 60.0})
    for (const double wind : {0.0, 3.0})
      cases.push_back({wind > 0 ? "growth and wind" : "growth",
                       scene_on(grid(10, 30, 0.05, wind, growth), 2, SourceEntry::through_F, 1, 1), 60});
  // A chain x_i' = 20 (x_{i-1} - x_i): one eigenvalue, and a field of values far from it.
  Triplets chain;
  for (int i = 0; i < 300; ++i) chain.emplace_back(i, i, -20.0);
  for (int i = 1; i < 300; ++i) chain.emplace_back(i, i - 1, 20.0);
  cases.push_back({"chain", scene_on(assemble(300, 300, chain), 1, SourceEntry::through_F, 1, 2), 80});
  // Pairs -a ± i b on rays inside and outside the widest sector.
  for (const double degrees : {50.0, 80.0}) {
    const double tangent = std::tan(degrees * std::numbers::pi / 180);
    Triplets pairs;
    for (int i = 0; i < 150; ++i)
      for (const auto& [r, c, value] : {std::tuple{0, 0, -1.0}, {1, 1, -1.0}, {0, 1, tangent}, {1, 0, -tangent}})
        pairs.emplace_back(2 * i + r, 2 * i + c, std::pow(1.05, i) * value);
    cases.push_back({"pairs", scene_on(assemble(300, 300, pairs), 2, SourceEntry::through_F, 1, 5), 100});
  }
  int answered = 0;
  for (const KernelCase& c : cases) {
    const DiscreteProblem p = discretise(c.scene, *backend, c.J);
    const auto kernel = sparse_kernel(p, {});
    if (!kernel) continue;
    ++answered;
    const oracle::DenseScene exact = oracle::write_out(dense_twin(c.scene));
    // The check samples a few lags only, so allow ten times its limit.
    EXPECT_LE(weight_distance(kernel->weights, oracle::weights(exact, p.h, c.J)), 10 * accepted_contour_error)
        << c.name << ": " << kernel->description;
    const RowMatrix x = oracle::states_of(exact, RowMatrix::Zero(c.J + 1, c.scene.constraints()));
    EXPECT_LE(distance(kernel->free, x * exact.N.transpose()), 10 * accepted_contour_error * x.cwiseAbs().maxCoeff())
        << c.name << ": " << kernel->description;
  }
  EXPECT_GE(answered, 3);
}

TEST(SparseKernel, MarchesToTheSolutionOfTheDenseTwin) {
  const auto backend = make_cpu_backend(2);
  for (const KernelCase& c : kernel_cases()) {
    const DiscreteProblem p = discretise(c.scene, *backend, c.J);
    const auto kernel = sparse_kernel(p, {});
    ASSERT_TRUE(kernel) << c.name;
    const oracle::Trajectory exact = oracle::march(oracle::write_out(dense_twin(c.scene)), c.J);
    ASSERT_EQ(exact.infeasible, -1) << c.name;
    const auto r = backend->array(c.J + 1, p.g.cols()), y = backend->array(c.J + 1, p.g.cols()),
               v = backend->array(c.J + 1, p.g.cols());
    backend->upload(kernel->free + p.g.table(), *r);
    RowMatrix start = RowMatrix::Zero(c.J + 1, p.g.cols());
    start.row(0) = exact.y.row(0);
    backend->upload(start, *y);
    MarchProblem problem;
    problem.M = &c.scene.M;
    problem.lcp_class = p.lcp_class;
    problem.lags = &kernel->weights;
    problem.r = r.get();
    const MarchReport report = backend->march(problem, c.J + 1)->run(*y, *v);
    EXPECT_EQ(report.count.solved, c.J) << c.name;
    RowMatrix found;
    backend->download(*y, found);
    EXPECT_LE(distance(found, exact.y), 1e-9 * std::max(1.0, exact.y.cwiseAbs().maxCoeff())) << c.name;
  }
}

TEST(SparseKernel, HasNoContourForOscillators) {
  Triplets ring;
  const int m = 300;
  for (int i = 0; i < m; ++i) {
    ring.emplace_back(i, (i + 1) % m, 100.0);
    ring.emplace_back((i + 1) % m, i, -100.0);
  }
  const auto backend = make_cpu_backend(2);
  const Scene scene = scene_on(assemble(m, m, ring), 2, SourceEntry::through_F, 0, 1);
  EXPECT_FALSE(sparse_kernel(discretise(scene, *backend, 200), {}));
}

TEST(SparseKernel, RefusesSourcesForTooManyStates) {
  const auto backend = make_cpu_backend(1);
  SparseMatrix A(5000, 5000);
  A.setIdentity();
  const Scene scene = scene_on(-A, 1, SourceEntry::state, 0, 1);
  const DiscreteProblem p = discretise(scene, *backend, 2);
  EXPECT_THROW(sparse_kernel(p, {}), Error);
}

TEST(SparseKernel, PredictsItsBytes) {
  const auto bytes = [](Index G, Index J, int threads) {
    const Scene scene = scene_on(grid(G, G), 2, SourceEntry::through_F, 0, 1);
    return predicted_sparse_bytes(get<SparseDynamics>(scene.dynamics), J, 3, 2, threads);
  };
  // Only the tables of W and S.
  EXPECT_GE(bytes(10, 10000, 1), 2 * sizeof(double) * 10001.0 * 3 * 2);
  EXPECT_LE(bytes(10, 10000, 1), 1e7);
  // The elimination holds O(G^2) entries per thread, at most a quarter above proportionality at these sizes.
  EXPECT_GT(bytes(40, 10, 2), 1.5 * bytes(40, 10, 1));
  EXPECT_LT(bytes(40, 10, 1), 1.3 * 4 * bytes(20, 10, 1));
}

}  // namespace
}  // namespace bromwich
