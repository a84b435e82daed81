// Chains of one-step maps against their dense block bidiagonal matrix, and against each other.
//
// Rounding: every row is the sum of at most M products of maps of norm about 1, and the assembled matrix has a
// condition number below 1e4. Two ways to the same sum agree to a few hundred roundings of the largest entry, 1e-13
// relative; the adjoint identity, a sum of (M+1) m products, to 1e-12.

#include "core/base/error.hpp"
#include "core/host/step_chain.hpp"
#include "tests/support/backends.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <string>

namespace bromwich {
namespace {

using reference::Random;

// Skew plus negative definite: every scheme contracts or keeps the norm.
Matrix passive_matrix(Random& random, Index m, double damping) {
  Matrix A = random.matrix(m, m);
  return A - A.transpose() - damping * Matrix::Identity(m, m);
}

Vector random_grid(Random& random, Index M) {
  Vector t(M + 1);
  t[0] = 0;
  for (Index i = 1; i <= M; ++i) t[i] = t[i - 1] + 0.02 + 0.05 * (1 + random.uniform());
  return t;
}

// Uniform, then bisected in places, like an adaptive grid.
Vector bisected_grid(Index coarse, int times) {
  std::vector<double> t;
  for (Index i = 0; i <= coarse; ++i) t.push_back(double(i) / double(coarse));
  for (int level = 0; level < times; ++level) {
    std::vector<double> finer{t.front()};
    for (std::size_t i = 1; i < t.size(); ++i) {
      if (i % 5 < 2) finer.push_back((t[i - 1] + t[i]) / 2);
      finer.push_back(t[i]);
    }
    t = finer;
  }
  return Eigen::Map<const Vector>(t.data(), Index(t.size()));
}

Matrix dense(const StepMatrix& matrix) {
  return std::holds_alternative<Matrix>(matrix) ? std::get<Matrix>(matrix) : Matrix(std::get<SparseMatrix>(matrix));
}

Matrix assembled(const StepChainProblem& problem) {
  const Index M = problem.steps(), m = problem.states();
  Matrix A = Matrix::Zero((M + 1) * m, (M + 1) * m);
  A.topLeftCorner(m, m).setIdentity();
  for (Index i = 1; i <= M; ++i) {
    const StepMap& map = problem.maps[std::size_t(problem.map_of[std::size_t(i - 1)])];
    A.block(i * m, i * m, m, m) = dense(map.S);
    A.block(i * m, (i - 1) * m, m, m) = -dense(map.R);
  }
  return A;
}

// The rows of an array, concatenated.
Vector stacked(const RowMatrix& rows) { return Eigen::Map<const Vector>(rows.data(), rows.size()); }

double relative(const RowMatrix& a, const RowMatrix& b) {
  return (a - b).cwiseAbs().maxCoeff() / std::max(1e-300, b.cwiseAbs().maxCoeff());
}

class StepChains : public BackendTest {
 protected:
  RowMatrix adjoint(StepChain& chain, const RowMatrix& q, AdjointMethod method = AdjointMethod::substitution,
                    Index sweeps = 1) {
    return chain.solve_transposed(q, {method, sweeps});
  }

  // z^T r with the residual r = d - A x, for any z and for weights from serial solves.
  void expect_residuals(StepChain& chain, const StepChainProblem& problem) {
    const Index M = problem.steps(), m = problem.states();
    Random random(18);
    const RowMatrix d = random.matrix(M + 1, m), x = random.matrix(M + 1, m), z = random.matrix(M + 1, m);
    const auto map = [&](Index i) -> const StepMap& {
      return problem.maps[std::size_t(problem.map_of[std::size_t(i - 1)])];
    };
    const auto weighed = [&](const RowMatrix& weights) {
      return Vector(Vector::NullaryExpr(M, [&](Index i) {
        const Vector r = d.row(i + 1).transpose() + dense(map(i + 1).R) * x.row(i).transpose() -
                         dense(map(i + 1).S) * x.row(i + 1).transpose();
        return weights.row(i + 1).dot(r);
      }));
    };
    const Vector expected = weighed(z);
    EXPECT_LE((chain.weighted_residual(d, x, z) - expected).cwiseAbs().maxCoeff(),
              1e-13 * double(m) * std::max(1., expected.cwiseAbs().maxCoeff()));
    if (M % 2 == 1) return;
    const RowMatrix l = random.matrix(M / 2 + 1, m);
    RowMatrix weights = z;
    for (Index c = 1; c <= M / 2; ++c)
      for (const Index i : {2 * c, 2 * c - 1}) {
        Vector mu = d.row(i).transpose();
        if (i % 2 == 1) mu += dense(map(i + 1).R).transpose() * weights.row(i + 1).transpose();
        if (i % 2 == 0 && i < M) mu += dense(map(i + 1).R).transpose() * l.row(c + 1).transpose();
        weights.row(i) = dense(map(i).S).transpose().partialPivLu().solve(mu).transpose();
      }
    const Vector locally = weighed(weights);
    EXPECT_LE((chain.locally_weighted_residual(d, x, d, l) - locally).cwiseAbs().maxCoeff(),
              1e-13 * double(m) * std::max(1., locally.cwiseAbs().maxCoeff()));
  }

  // Properties of any chain.
  void expect_chain(const StepChainProblem& problem, const std::string& name) {
    SCOPED_TRACE(name);
    const Index M = problem.steps(), m = problem.states();
    Random random(17);
    const RowMatrix d = random.matrix(M + 1, m), q = random.matrix(M + 1, m);
    const auto chain = backend->step_chain(problem);
    const RowMatrix x = chain->solve(d), l = adjoint(*chain, q);
    EXPECT_EQ(chain->solve(d), x);
    for (const AdjointMethod method : {AdjointMethod::exact, AdjointMethod::substitution, AdjointMethod::jacobi,
                                       AdjointMethod::doubling, AdjointMethod::scan})
      EXPECT_EQ(chain->solve_transposed(q, {method, 2}), adjoint(*chain, q, method, 2));
    for (const AdjointMethod method : {AdjointMethod::exact, AdjointMethod::doubling, AdjointMethod::scan})
      EXPECT_LE(relative(adjoint(*chain, q, method), l), 1e-13);
    EXPECT_LE(relative(adjoint(*chain, q, AdjointMethod::jacobi, M + 1), l), 1e-13);
    const double pairing = x.cwiseProduct(q).sum(), size = x.cwiseProduct(q).cwiseAbs().sum();
    EXPECT_LE(std::abs(pairing - d.cwiseProduct(l).sum()), 1e-12 * size);  // <x, A^T l> = <A x, l>
    expect_residuals(*chain, problem);
    if ((M + 1) * m > 600) return;
    const Matrix A = assembled(problem);
    EXPECT_LE((A * stacked(x) - stacked(d)).cwiseAbs().maxCoeff(), 1e-12 * x.cwiseAbs().maxCoeff());
    EXPECT_LE((A.transpose() * stacked(l) - stacked(q)).cwiseAbs().maxCoeff(), 1e-12 * l.cwiseAbs().maxCoeff());
    // Jacobi by the assembled matrix: D l = q - (A^T - D) l, D block diagonal.
    for (const Index sweeps : {1, 2, 3}) {
      Matrix D = Matrix::Zero(A.rows(), A.cols());
      for (Index i = 0; i <= M; ++i) D.block(i * m, i * m, m, m) = A.block(i * m, i * m, m, m).transpose();
      const Eigen::PartialPivLU<Matrix> lu(D);
      Vector iterate = Vector::Zero(A.rows());
      for (Index s = 0; s < sweeps; ++s) iterate = lu.solve(Vector(stacked(q) - (A.transpose() - D) * iterate));
      EXPECT_LE((stacked(adjoint(*chain, q, AdjointMethod::jacobi, sweeps)) - iterate).cwiseAbs().maxCoeff(),
                1e-12 * iterate.cwiseAbs().maxCoeff());
    }
  }
};

TEST_P(StepChains, AllDistinctSizes) {
  Random random(3);
  for (const Index m : {1, 3, 16}) {
    const Matrix A = passive_matrix(random, m, 0.5);
    for (const Index M : {1, 2, 5, 31, 64})
      for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential})
        expect_chain(step_chain_problem(scheme, A, group_steps(random_grid(random, M))),
                     "m " + std::to_string(m) + ", M " + std::to_string(M));
  }
}

TEST_P(StepChains, BisectedGrids) {
  Random random(4);
  for (const Index m : {2, 16, 37, 64}) {
    const Matrix A = passive_matrix(random, m, 0.1);
    const StepSizes steps = group_steps(bisected_grid(12, 4));
    EXPECT_EQ(steps.sizes.size(), 5);
    expect_chain(step_chain_problem(StepScheme::euler, A, steps), "m " + std::to_string(m));
  }
}

TEST_P(StepChains, SparseIsDense) {
  Random random(5);
  const Index m = 23;
  Matrix A = -Matrix::Identity(m, m);
  for (Index i = 0; i + 1 < m; ++i) {
    A(i, i + 1) = 3 * random.uniform();
    A(i + 1, i) = -A(i, i + 1);
  }
  const SparseMatrix sparse_A = A.sparseView();
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint}) {
    const StepSizes steps = group_steps(bisected_grid(7, 2));
    const StepChainProblem sparse = step_chain_problem(scheme, sparse_A, steps),
                           full = step_chain_problem(scheme, A, steps);
    expect_chain(sparse, "sparse");
    const RowMatrix d = random.matrix(steps.of.size() + 1, m);
    const auto a = backend->step_chain(sparse), b = backend->step_chain(full);
    EXPECT_LE(relative(a->solve(d), b->solve(d)), 1e-13);
    for (const AdjointMethod method : {AdjointMethod::substitution, AdjointMethod::jacobi})
      EXPECT_LE(relative(adjoint(*a, d, method, 3), adjoint(*b, d, method, 3)), 1e-13);
  }
}

// More states than a block of a device holds, and sparse maps small enough to be converted to dense ones there.
TEST_P(StepChains, ManyStates) {
  Random random(8);
  for (const Index m : {63, 64, 65, 200}) {
    const Matrix A = passive_matrix(random, m, 0.5) / std::sqrt(double(m));
    const SparseMatrix sparse_A = A.sparseView();
    for (const Index M : m == 65 ? std::vector<Index>{1, 2, 9} : std::vector<Index>{2}) {
      expect_chain(step_chain_problem(StepScheme::euler, A, group_steps(random_grid(random, M))),
                   "dense, all distinct");
      expect_chain(step_chain_problem(StepScheme::midpoint, sparse_A, group_steps(random_grid(random, M))), "sparse");
    }
    if (m == 65) expect_chain(step_chain_problem(StepScheme::midpoint, A, group_steps(bisected_grid(90, 4))), "scan");
  }
}

TEST_P(StepChains, SayWhatTheHostDoes) {
  const auto on_host = [&](const StepMatrix& A) {
    return backend->step_chain(step_chain_problem(StepScheme::euler, A, group_steps(Vector::LinSpaced(3, 0, 1))))
        ->on_host;
  };
  SparseMatrix large(400, 400);
  large.setIdentity();
  const bool device = bool(backend->fused().step_chain);
  EXPECT_EQ(on_host(Matrix(-Matrix::Identity(70, 70))), !device);
  EXPECT_EQ(on_host(SparseMatrix(-large.topLeftCorner(70, 70))), !device);
  EXPECT_TRUE(on_host(SparseMatrix(-large)));
}

// Values that are not finite propagate to the rows that depend on them, and to no others.
TEST_P(StepChains, CarryWhatIsNotFinite) {
  Random random(9);
  for (const Index m : {3, 70}) {
    const Index M = 600, bad = 300;
    const auto chain = backend->step_chain(step_chain_problem(StepScheme::euler, passive_matrix(random, m, 1),
                                                              group_steps(Vector::LinSpaced(M + 1, 0, 6))));
    RowMatrix d = random.matrix(M + 1, m);
    d(bad, m / 2) = std::numeric_limits<double>::quiet_NaN();
    const RowMatrix x = chain->solve(d);
    EXPECT_TRUE(x.topRows(bad).allFinite());
    EXPECT_FALSE(x.row(bad).allFinite());
    EXPECT_FALSE(x.row(M).allFinite());
    for (const AdjointMethod method : {AdjointMethod::substitution, AdjointMethod::scan, AdjointMethod::doubling}) {
      const RowMatrix l = adjoint(*chain, d, method);
      EXPECT_TRUE(l.bottomRows(M - bad).allFinite());
      EXPECT_FALSE(l.row(bad).allFinite());
      EXPECT_FALSE(l.row(0).allFinite());
    }
  }
}

TEST_P(StepChains, MapsOfAnyKind) {  // R not the identity, S and R unrelated, two maps in any order
  Random random(6);
  const Index m = 5;
  StepChainProblem problem;
  for (int k = 0; k < 3; ++k)
    problem.maps.push_back(
        {Matrix(3 * Matrix::Identity(m, m) + random.matrix(m, m) / 2), Matrix(random.matrix(m, m) / 2)});
  for (Index i = 0; i < 40; ++i) problem.map_of.push_back((i * i) % 3);
  expect_chain(problem, "any");
}

TEST_P(StepChains, JacobiContractsForHurwitz) {
  Random random(7);
  const Matrix A = passive_matrix(random, 4, 8);  // a step of 0.1 damps by 1/1.8
  const auto chain =
      backend->step_chain(step_chain_problem(StepScheme::euler, A, group_steps(Vector::LinSpaced(101, 0, 10))));
  const RowMatrix q = random.matrix(101, 4), exact = adjoint(*chain, q);
  // Row 0 has no step: its error is that of row 1 before the last sweep, not damped.
  const auto error = [&](Index sweeps) {
    return (adjoint(*chain, q, AdjointMethod::jacobi, sweeps) - exact).bottomRows(100).norm();
  };
  double before = error(1);
  for (const Index sweeps : {2, 3, 4, 5, 6}) {
    const double now = error(sweeps);
    // G = P^T with ||P||_2 <= 1/(1 + 0.8), and l = S^{-T} mu with S^{-T} = P^T, which commute.
    EXPECT_LE(now, before / 1.8 * (1 + 1e-10));
    before = now;
  }
}

TEST_P(StepChains, LongUndampedChainKeepsItsNorm) {
  Matrix A(2, 2);
  A << 0, 3, -3, 0;
  const Index M = 4000;
  const auto chain =
      backend->step_chain(step_chain_problem(StepScheme::midpoint, A, group_steps(Vector::LinSpaced(M + 1, 0, 100))));
  RowMatrix d = RowMatrix::Zero(M + 1, 2);
  d.row(0) << 1, 0;
  const RowMatrix x = chain->solve(d);
  EXPECT_LE((x.rowwise().norm().array() - 1).abs().maxCoeff(), double(M) * epsilon * 2);
  RowMatrix q = RowMatrix::Zero(M + 1, 2);
  q.row(M) << 0, 1;
  const RowMatrix l = adjoint(*chain, q);
  EXPECT_NEAR(l(0, 0), x(M, 1), double(M) * epsilon * 2);                      // l_0 = (∂ x_M / ∂ x_0)^T q_M
  EXPECT_LE(relative(adjoint(*chain, q, AdjointMethod::doubling), l), 1e-12);  // rounding: M eps
  EXPECT_LE(relative(adjoint(*chain, q, AdjointMethod::scan), l), 1e-12);
}

TEST_P(StepChains, RefusesWhatCannotBe) {
  const StepMap good{Matrix(Matrix::Identity(2, 2)), Matrix(Matrix::Identity(2, 2))};
  const auto refused = [&](const StepChainProblem& problem, const std::string& words) {
    try {
      backend->step_chain(problem);
      ADD_FAILURE() << "accepted where '" << words << "' was expected";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  };
  refused({{good}, {}}, "steps: found none");
  refused({{}, {0}}, "maps: found none");
  refused({{good}, {0, 1}}, "step 2: found map 1");
  refused({{good, {Matrix(Matrix::Identity(3, 3)), Matrix(Matrix::Identity(3, 3))}}, {0}}, "map 1: found S or R");
  refused({{{Matrix(Matrix::Zero(2, 2)), Matrix(Matrix::Identity(2, 2))}}, {0}}, "singular");
  refused({{{SparseMatrix(2, 2), SparseMatrix(2, 2)}}, {0}}, "singular");
  const Matrix I = Matrix::Identity(2, 2);
  refused({{{I, I, I}}, {0}}, "map 0: found a change that is not R - S");
  refused({{{I, I, Matrix(Matrix::Zero(3, 3))}}, {0}}, "map 0: found S or R");
  Matrix nearly(3, 3);  // singular to rounding, with pivots that are not zero
  nearly << 1, 2, 3, 4, 5, 6, 7, 8, 9;
  nearly *= 0.1;
  const SparseMatrix nearly_sparse = nearly.sparseView();
  refused({{{nearly, nearly}}, {0}}, "singular matrix S, of step 1");
  refused({{{nearly_sparse, nearly_sparse}}, {0}}, "singular matrix S, of step 1");
  refused({{good, {SparseMatrix(2, 2), SparseMatrix(2, 2)}}, {0}}, "dense and sparse");
  refused({{{Matrix(Matrix::Constant(2, 2, NAN)), Matrix(Matrix::Identity(2, 2))}}, {0}}, "not finite");

  const auto chain = backend->step_chain({{good}, {0, 0, 0}});
  const RowMatrix q = RowMatrix::Ones(4, 2);
  EXPECT_THROW(adjoint(*chain, q, AdjointMethod::jacobi, 0), Error);
  const auto small = backend->step_chain({{good}, {0, 0, 0}, 8.0});
  EXPECT_THROW(adjoint(*small, q, AdjointMethod::doubling), Error);
  EXPECT_THROW(adjoint(*small, q, AdjointMethod::scan), Error);
  EXPECT_EQ(adjoint(*small, q), adjoint(*chain, q));
}

INSTANTIATE_TEST_SUITE_P(Backends, StepChains, testing::ValuesIn(backend_cases()), backend_case_name);

TEST(DenseStep, IsTheSameOfSparseMaps) {
  Random random(10);
  const Index m = 12;
  const Matrix A = passive_matrix(random, m, 1);
  const StepSizes steps = group_steps(Vector::LinSpaced(2, 0, 0.1));
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint}) {
    const DenseStep full(step_chain_problem(scheme, A, steps), 0),
        sparse(step_chain_problem(scheme, SparseMatrix(A.sparseView()), steps), 0);
    EXPECT_LE((full.increment - sparse.increment).cwiseAbs().maxCoeff(), 1e-14);
    EXPECT_LE((full.inverse - sparse.inverse).cwiseAbs().maxCoeff(), 1e-14);
    EXPECT_EQ(full.R, sparse.R);
    EXPECT_EQ(full.change, sparse.change);
  }
}

TEST(StepSizes, RoundingIsNoDifference) {
  const Vector t = bisected_grid(10, 6) * 5e-6;
  const StepSizes steps = group_steps(t);
  std::set<long> halvings;
  for (Index i = 0; i + 1 < t.size(); ++i) halvings.insert(std::lround(std::log2(5e-7 / (t[i + 1] - t[i]))));
  EXPECT_EQ(steps.sizes.size(), Index(halvings.size()));
  for (Index i = 0; i + 1 < t.size(); ++i) EXPECT_NEAR(steps.h(i), t[i + 1] - t[i], 8 * epsilon * 5e-6);
  EXPECT_THROW(group_steps(Vector::Zero(3)), Error);
  EXPECT_THROW(group_steps(Vector::Zero(1)), Error);
}

TEST(WindowNames, NameWindowsByTheirSymbols) {
  const std::vector<Index> symbols{0, 1, 0, 1, 1, 0, 1, 0, 1, 1, 0, 0, 0, 0, 0};
  std::vector<Index> names = symbols;
  Index kinds = 2;
  for (Index length = 1; 2 * length <= Index(symbols.size()); length *= 2) {
    const WindowNames windows = join_windows(names, kinds, length);
    ASSERT_EQ(windows.of.size(), symbols.size() + 1 - 2 * std::size_t(length));
    for (std::size_t i = 0; i < windows.of.size(); ++i)
      for (std::size_t j = 0; j < windows.of.size(); ++j)
        EXPECT_EQ(
            windows.of[i] == windows.of[j],
            std::equal(symbols.begin() + long(i), symbols.begin() + long(i) + 2 * length, symbols.begin() + long(j)));
    names = windows.of;
    kinds = Index(windows.halves.size());
  }
}

}  // namespace
}  // namespace bromwich
