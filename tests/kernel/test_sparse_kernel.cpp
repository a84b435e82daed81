// Large sparse A at sizes that allow dense references: the resolvent against dense solves, spectrum estimates against
// known eigenvalues, and the kernel against the oracle's matrix functions.

#include "core/base/error.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/sparse_kernel.hpp"
#include "core/numerics/elimination.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/dense_twin.hpp"
#include "tests/support/oracle.hpp"

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>

#include <numbers>

namespace bromwich {
namespace {

using reference::Random;
using Triplets = std::vector<Eigen::Triplet<double>>;

SparseMatrix assemble(Index rows, Index cols, const Triplets& entries) {
  SparseMatrix A(rows, cols);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

/// Five-point Laplacian of a G x H grid on a square with spacing 1/(G+1), plus central differences of a wind.
SparseMatrix grid(Index G, Index H, double diffusivity = 1, double wind = 0, double growth = 0) {
  const double dx = 1.0 / double(G + 1), c = diffusivity / (dx * dx), a = 0.5 * wind / dx;
  Triplets entries;
  for (Index i = 0; i < G; ++i)
    for (Index j = 0; j < H; ++j) {
      const Index r = i * H + j;
      entries.emplace_back(r, r, -4 * c + growth);
      if (i > 0) entries.emplace_back(r, r - H, c + a);
      if (i + 1 < G) entries.emplace_back(r, r + H, c - a);
      if (j > 0) entries.emplace_back(r, r - 1, c);
      if (j + 1 < H) entries.emplace_back(r, r + 1, c);
    }
  return assemble(G * H, G * H, entries);
}

/// Entries of a random pattern, `filled` per row on average.
SparseMatrix random_sparse(Random& random, Index rows, Index cols, double filled) {
  Triplets entries;
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j)
      if (random.uniform(0, 1) * double(cols) < filled) entries.emplace_back(i, j, random.uniform());
  return assemble(rows, cols, entries);
}

ComplexMatrix dense_resolvent(const SparseDynamics& d, const ComplexVector& nodes) {
  const Index m = d.A.rows(), n = d.N.rows(), k = d.B.cols();
  ComplexMatrix R(nodes.size(), n * k);
  for (Index p = 0; p < nodes.size(); ++p) {
    const ComplexMatrix shifted = nodes[p] * ComplexMatrix::Identity(m, m) - Matrix(d.A).cast<Complex>();
    const ComplexMatrix X = Matrix(d.N).cast<Complex>() * shifted.partialPivLu().solve(Matrix(d.B).cast<Complex>());
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < k; ++j) R(p, i * k + j) = X(i, j);
  }
  return R;
}

class SparseResolvent : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(Contract, SparseResolvent, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(SparseResolvent, AgreesWithDenseSolves) {
  Random random(3);
  // One state; a symmetric grid; a wind; an unsymmetric pattern with empty rows; several components; and a full matrix,
  // which is a single front with several panels.
  const std::vector<SparseMatrix> matrices{assemble(1, 1, {{0, 0, -2.0}}),
                                           grid(9, 7),
                                           grid(8, 8, 1, 30),
                                           random_sparse(random, 50, 50, 2),
                                           assemble(40, 40, {{0, 1, 1.0}, {7, 7, -3.0}, {30, 2, 2.0}}),
                                           random.matrix(75, 75).sparseView()};
  for (const SparseMatrix& A : matrices)
    for (const auto& [outputs, inputs] : {std::pair<Index, Index>{1, 1}, {3, 2}, {2, 11}}) {
      const Index m = A.rows();
      // Columns that are sparse, and one that is full.
      SparseMatrix B = random_sparse(random, m, inputs, 1.0), N = random_sparse(random, outputs, m, 3.0);
      B.coeffRef(0, 0) = 1;
      N.coeffRef(outputs - 1, m - 1) = 1;
      if (inputs == 11) B = Matrix(random.matrix(m, inputs)).sparseView();
      const SparseDynamics d{A, B, N};
      // No node is close to an eigenvalue: nodes have imaginary parts above 12, random spectra have radii below 12.
      ComplexVector all(17);
      for (Index p = 0; p < all.size(); ++p) all[p] = Complex(5 - 3 * double(p), 13 + 2 * double(p));
      const ComplexMatrix all_exact = dense_resolvent(d, all);
      for (const Index count : {1, 8, 17}) {
        const ComplexVector nodes = all.head(count);
        const ComplexMatrix found = backend->resolvent(Dynamics(d), nodes), exact = all_exact.topRows(count);
        ASSERT_EQ(found.rows(), exact.rows());
        ASSERT_EQ(found.cols(), exact.cols());
        // Condition numbers below 1e3, sums of about 100 operations: 1e3 * 100 eps.
        EXPECT_LE((found - exact).cwiseAbs().maxCoeff(), 1e-11 * exact.cwiseAbs().maxCoeff()) << m << ' ' << count;
      }
    }
}

TEST_P(SparseResolvent, PivotsWhereTheOrderNeedsIt) {
  // Without pivoting the first pivot is z = 0, which is not an eigenvalue (they are 1 and -1).
  const SparseDynamics d{assemble(2, 2, {{0, 1, 1.0}, {1, 0, 1.0}}), assemble(2, 1, {{0, 0, 1.0}}),
                         assemble(1, 2, {{0, 1, 1.0}})};
  const ComplexMatrix R = backend->resolvent(Dynamics(d), ComplexVector{{Complex(0, 0), Complex(0, 2)}});
  EXPECT_LE(std::abs(R(0, 0) + 1.0), 1e-15);
  // (2i I - A)^{-1} = (2i I + A)/(-4 - 1).
  EXPECT_LE(std::abs(R(1, 0) + 0.2), 1e-15);
}

TEST_P(SparseResolvent, RefusesAnEigenvalue) {
  const SparseMatrix diagonal = assemble(3, 3, {{0, 0, -1.0}, {1, 1, -2.0}, {2, 2, -3.0}});
  const SparseMatrix pair = assemble(2, 2, {{0, 0, -2.0}, {0, 1, 1.0}, {1, 0, 1.0}, {1, 1, -2.0}});
  for (const auto& [A, z] : {std::pair{diagonal, -2.0}, {pair, -1.0}}) {
    const SparseMatrix B = Matrix::Ones(A.rows(), 1).sparseView(), N = Matrix::Ones(1, A.rows()).sparseView();
    const Dynamics dynamics = SparseDynamics{A, B, N};
    const auto at = [&](Complex node) { backend->resolvent(dynamics, ComplexVector{{Complex(1, 1), node}}); };
    EXPECT_THROW(at(z), Error);
    EXPECT_NO_THROW(at(Complex(z, 1e-3)));
  }
}

TEST(Elimination, CountsAFullMatrix) {
  // One front: 10 pivots, 1 output, 2 inputs and a dense one.
  const SparseMatrix A = Matrix::Ones(10, 10).sparseView(), B = Matrix::Ones(10, 2).sparseView(),
                     N = Matrix::Ones(1, 10).sparseView();
  const Elimination e = analyse(A, B, N, 1);
  ASSERT_EQ(e.fronts.size(), 1u);
  EXPECT_EQ(e.largest_front, 11 * 13);
  EXPECT_EQ(e.largest_stack, 0);
  double products = 0;
  for (int p = 1; p <= 10; ++p) products += (11 - p) * (13 - p);
  EXPECT_EQ(e.products, products);
}

TEST(Elimination, StaysSmallOnAGrid) {
  // Nested dissection of a G x G grid leaves O(G^2) on the stack. A band order would cost G^4 = 3e5 times 24, a good
  // order 31 G^3 (George, 1973), with room for a factor of 4.
  const Index G = 24;
  const SparseMatrix A = grid(G, G), none(G * G, 0), nothing(0, G * G);
  const Elimination e = analyse(A, none, nothing, 0);
  EXPECT_LE(e.products, 4 * 31 * double(G * G * G));
  EXPECT_LE(e.largest_stack, 4 * G * G);
  std::vector<int> order = e.order;
  std::sort(order.begin(), order.end());
  for (Index i = 0; i < G * G; ++i) ASSERT_EQ(order[std::size_t(i)], i);
}

TEST(Elimination, FrontsHoldFewZeros) {
  // Entries of the fronts' columns against those of the Cholesky factor in the same order, counted by Eigen.
  const Index G = 60, m = G * G;
  const SparseMatrix A = grid(G, G), none(m, 0), nothing(0, m);
  const Elimination e = analyse(A, none, nothing, 0);
  Index held = 0;
  for (const Front& front : e.fronts)
    held += front.pivots * (front.pivots + 1) / 2 + front.pivots * Index(front.rest.size());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> to(m);
  for (Index i = 0; i < m; ++i) to.indices()[e.order[std::size_t(i)]] = int(i);
  const SparseMatrix negative = -A;
  SparseMatrix ordered;
  ordered = negative.twistedBy(to);
  const Eigen::SimplicialLLT<SparseMatrix, Eigen::Lower, Eigen::NaturalOrdering<int>> cholesky(ordered);
  const Index needed = SparseMatrix(cholesky.matrixL()).nonZeros();
  EXPECT_GE(held, needed);
  EXPECT_LE(15 * held, 16 * needed);
}

TEST(SparseSpectrum, SymmetricGrid) {
  const Index G = 20;
  const double dx = 1.0 / double(G + 1), s = std::sin(std::numbers::pi * dx / 2);
  const double fastest = 8 / (dx * dx) * (1 - s * s), slowest = 8 / (dx * dx) * s * s;
  const Spectrum stable = sparse_spectrum(grid(G, G));
  EXPECT_EQ(stable.half_angle, 0);
  EXPECT_EQ(stable.abscissa, 0);  // Gershgorin's bound
  // Ritz values lie inside the spectrum; 32 steps on 400 states find its end to a few percent.
  EXPECT_LE(stable.radius, fastest * (1 + 1e-12));
  EXPECT_GE(stable.radius, 0.9 * fastest);
  // Growth 50 moves the largest eigenvalue to 50 - slowest; the search finds it from above, within a factor of 2.
  const Spectrum unstable = sparse_spectrum(grid(G, G, 1, 0, 50));
  EXPECT_GE(unstable.abscissa, 50 - slowest);
  EXPECT_LE(unstable.abscissa, 2 * (50 - slowest));
  EXPECT_FALSE(unstable.real_negative());
  // Growth below `slowest`: the Gershgorin discs extend beyond 0, the eigenvalues do not.
  EXPECT_EQ(sparse_spectrum(grid(G, G, 1, 0, 0.5 * slowest)).abscissa, 0);
}

TEST(SparseSpectrum, SectorsAndSkewMatrices) {
  // Normal: blocks -a [[1, -tan], [tan, 1]], eigenvalues on the rays of 40 degrees.
  const double tangent = std::tan(40 * std::numbers::pi / 180);
  Triplets entries;
  for (Index i = 0; i < 150; ++i) {
    const double a = 1 + 0.1 * double(i);
    entries.insert(entries.end(), {{int(2 * i), int(2 * i), -a},
                                   {int(2 * i + 1), int(2 * i + 1), -a},
                                   {int(2 * i), int(2 * i + 1), a * tangent},
                                   {int(2 * i + 1), int(2 * i), -a * tangent}});
  }
  const Spectrum sector = sparse_spectrum(assemble(300, 300, entries));
  // The field of values is the convex hull of the eigenvalues: the estimate is close to 40 degrees and not above.
  EXPECT_LE(sector.half_angle, 40.001 * std::numbers::pi / 180);
  EXPECT_GE(sector.half_angle, 35 * std::numbers::pi / 180);
  EXPECT_LE(sector.radius, 15.9 / std::cos(40 * std::numbers::pi / 180) * (1 + 1e-12));
  EXPECT_GE(sector.radius, 0.9 * 15.9 / std::cos(40 * std::numbers::pi / 180));

  Triplets ring;
  for (Index i = 0; i < 300; ++i) {
    ring.emplace_back(i, (i + 1) % 300, 1.0);
    ring.emplace_back((i + 1) % 300, i, -1.0);
  }
  const Spectrum skew = sparse_spectrum(assemble(300, 300, ring));
  EXPECT_EQ(skew.half_angle, std::numbers::pi / 2);
  EXPECT_EQ(skew.abscissa, 0);
  EXPECT_LE(skew.radius, 2 + 1e-12);
  EXPECT_GE(skew.radius, 1.8);
}

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
