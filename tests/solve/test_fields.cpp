// Sparse dynamics with contact along a side, through whole solves: which methods refuse what, and bad input. 676 states
// are above those written out as dense, 26 contacts with 1600 steps above those whose weights are tabulated.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/result/result.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/dense_twin.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

constexpr Index Q = 26, m = Q * Q, many_steps = 1600;

SparseMatrix unit_mass() {
  SparseMatrix E(m, m);
  E.setIdentity();
  return E;
}

// Heat in Q x Q cells, kept at 0 on all sides but the insulated one with the contacts.
SparseDynamics heated_square() {
  const double scale = 0.05 * double(Q + 1) * double(Q + 1);
  std::vector<Eigen::Triplet<double>> entries;
  SparseDynamics d{SparseMatrix(m, m), SparseMatrix(m, Q), SparseMatrix(Q, m)};
  for (Index i = 0; i < Q; ++i)
    for (Index k = 0; k < Q; ++k) {
      const Index cell = i * Q + k;
      entries.emplace_back(cell, cell, k > 0 ? -4 * scale : -3 * scale);
      if (k > 0) entries.emplace_back(cell, cell - 1, scale);
      if (k + 1 < Q) entries.emplace_back(cell, cell + 1, scale);
      if (i > 0) entries.emplace_back(cell, cell - Q, scale);
      if (i + 1 < Q) entries.emplace_back(cell, cell + Q, scale);
    }
  d.A.setFromTriplets(entries.begin(), entries.end());
  for (Index i = 0; i < Q; ++i) {
    d.B.insert(i * Q, i) = double(Q + 1);
    d.N.insert(i, i * Q) = 1;
  }
  return d;
}

Scene field(const SparseDynamics& d, double compliance) {
  Scene scene;
  scene.name = "field";
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Zero(Q), Vector::Constant(Q, compliance), Vector::Zero(Q)};
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < Q; ++i)
      g[i] = 0.05 - 0.4 * std::sin(3 * t) * std::sin(std::numbers::pi * double(i + 1) / double(Q + 1));
  };
  scene.x0 = Vector::Zero(m);
  scene.T = 2;
  return scene;
}

Result solved_by(const Scene& scene, Method method, Index steps) {
  Options options;
  options.method = method;
  options.steps = steps;
  return solve(scene, *make_cpu_backend(2), options);
}

// Without a node: its row and column of A, and its entry of E where `mass` is 0.
SparseDynamics isolated(Index node, double mass) {
  SparseDynamics d = heated_square();
  for (Index k = 0; k < m; ++k)
    for (SparseMatrix::InnerIterator a(d.A, k); a; ++a)
      if (a.row() == node || k == node) a.valueRef() = 0;
  d.A.prune(0.0);
  d.E = unit_mass();
  d.E.coeffRef(node, node) = mass;
  d.E.prune(0.0);
  return d;
}

TEST(Fields, SweepsThatCannotContractAreNotTried) {
  const Scene scene = field(heated_square(), 1e-2);
  for (const Index steps : {Index(64), many_steps}) {  // tables of weights, poles
    const Result swept = solved_by(scene, Method::contour, steps);
    EXPECT_EQ(swept.status, Status::unsupported);
    EXPECT_NE(swept.reason.find("outweighs M in every row"), std::string::npos) << swept.reason;
    EXPECT_EQ(swept.iterations, 0);
  }
  const Result chosen = solved_by(scene, Method::automatic, many_steps);
  ASSERT_EQ(chosen.status, Status::solved) << chosen.reason;
  EXPECT_EQ(chosen.method, Method::march);
  EXPECT_GT((chosen.y.array() > 0).count(), 1000);
}

TEST(Fields, MultigridTakesCyclesInWWhereSweepsDoNotContract) {
  const Scene scene = field(heated_square(), 1e-2);
  constexpr Index steps = 64;
  const Result cycled = solved_by(scene, Method::multigrid, steps);
  ASSERT_EQ(cycled.status, Status::solved) << cycled.reason;
  EXPECT_NE(cycled.kernel.find("cycles in w"), std::string::npos) << cycled.kernel;
  // Implicit Euler at worst, of order one, whose own steps method euler takes.
  const Result euler = solved_by(scene, Method::euler, steps), march = solved_by(scene, Method::march, steps);
  const double apart = (cycled.y - march.y).bottomRows(steps).cwiseAbs().mean(),
               of_euler = (euler.y - march.y).bottomRows(steps).cwiseAbs().mean();
  EXPECT_LE(apart, 1.1 * of_euler);
  EXPECT_GT((march.y.array() > 0).count(), 100);
}

// x0 behind the constraints and a small compliance: y_0 answers x0 alone, and vanishes within less than a step. Carried
// over the first step as a line it moved the state by ten times as much as y does. Implicit Euler, of order one, has
// small steps in the comparison.
TEST(Fields, AStartBehindTheConstraintsMovesTheStateByWhatYDoes) {
  constexpr Index steps = 64, fine = 50 * steps;
  for (Scene scene : {field(heated_square(), 1e-3), make_scene("contact", {{"Q", 24}, {"eps", 1e-3}})}) {
    SCOPED_TRACE(scene.name);
    scene.x0.setConstant(-0.5);
    const RowMatrix all = integral_of_y(solved_by(scene, Method::euler, fine)),
                    expected = all(Eigen::seq(0, fine, 50), Eigen::all);
    for (const Method method : {Method::march, Method::automatic}) {
      const Result found = solved_by(scene, method, steps);
      ASSERT_EQ(found.status, Status::solved) << found.reason;
      const double apart = (integral_of_y(found) - expected).cwiseAbs().maxCoeff();
      EXPECT_LE(apart, 0.05 * expected.maxCoeff()) << to_string(method);
    }
    EXPECT_NE(solved_by(scene, Method::contour, steps).status, Status::solved);
  }
}

// A start that stays pressed is no impulse: y follows from the state as it does later.
TEST(Fields, AStartThatStaysPressedIsMarchedByWeights) {
  Scene scene = field(heated_square(), 0.5);
  scene.g = [](double, Eigen::Ref<Vector> g) { g.setConstant(-0.1); };
  scene.f_entry = SourceEntry::through_B;
  scene.f = [](double, Eigen::Ref<Vector> f) { f.setConstant(-0.2); };
  const Result found = solved_by(scene, Method::march, 400);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_GT(found.y.row(0).minCoeff(), 0.1);
  EXPECT_TRUE(found.continuous);
  EXPECT_EQ(found.warning, "");
}

// A compliance above the first lag of the kernel: the refusal is not for these.
TEST(Fields, SweepsThatContractAreTaken) {
  const Scene scene = field(heated_square(), 5);
  const Result swept = solved_by(scene, Method::contour, many_steps),
               march = solved_by(scene, Method::march, many_steps);
  ASSERT_EQ(swept.status, Status::solved) << swept.reason;
  EXPECT_LE((swept.y - march.y).cwiseAbs().maxCoeff(), 1e-9 * march.y.maxCoeff());
}

// f per state as shapes times functions of time: the shapes are columns F. One column for each of 5000 states is
// refused.
TEST(Fields, ShapesOfASourceOfTheStatesAreColumns) {
  constexpr Index m = 5000;
  SparseDynamics d;
  d.A.resize(m, m), d.B.resize(m, 1), d.N.resize(1, m);
  for (Index i = 0; i < m; ++i) d.A.insert(i, i) = -1 - double(i % 7);
  d.B.insert(0, 0) = d.N.insert(0, 0) = 1;
  Scene scene;
  scene.dynamics = d;
  scene.M = Matrix{{1}};
  scene.x0 = Vector::Zero(m);
  scene.T = 2;
  const TimeFunction wave = [](double t, Eigen::Ref<Vector> a) { a[0] = -std::sin(3 * t); };
  Scene by_columns = scene;
  by_columns.F = Matrix::Ones(m, 1).sparseView();
  by_columns.f = wave;
  by_columns.f_entry = SourceEntry::through_F;
  scene.f = SeparableSource{Matrix::Ones(m, 1), wave};
  const auto backend = make_cpu_backend();
  const Options options{.steps = 50};
  const Result found = solve(scene, *backend, options), expected = solve(by_columns, *backend, options);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  EXPECT_GT(expected.y.maxCoeff(), 0.1);
  EXPECT_EQ(found.y, expected.y);
  EXPECT_NE(part_of(scene, 0.5, 1, scene.x0).f.separable(), nullptr);
  scene.f = [](double t, Eigen::Ref<Vector> f) { f.setConstant(-std::sin(3 * t)); };
  EXPECT_THROW(solve(scene, *backend, options), Error);
}

TEST(Fields, ASingularMassIsNamedByEveryMethod) {
  const Index node = 5 * Q + 7;
  SparseDynamics rank = heated_square();
  rank.E = unit_mass();
  rank.E.coeffRef(10, 11) = rank.E.coeffRef(11, 10) = 1;  // two equal rows
  SparseDynamics row = heated_square();
  row.E = unit_mass();
  row.E.coeffRef(node, node) = 0;
  // One row twice in both matrices: zE - A is singular for all z.
  SparseDynamics twice = heated_square();
  twice.E = unit_mass();
  for (SparseMatrix* matrix : {&twice.A, &twice.E}) {
    SparseMatrix transposed = matrix->transpose();
    transposed.col(node) = transposed.col(node - 1).eval();
    *matrix = transposed.transpose();
  }
  // A node that no element has: its row is zero in both matrices.
  const std::vector<std::pair<SparseDynamics, std::string>> cases{
      {rank, "eliminate the algebraic equations"},
      {row, "row 137 of E is zero, an algebraic equation"},
      {twice, "so is zE - A for all z"},
      {isolated(node, 0), "row 137 of E and of A is zero, as that of a node that no element has: take it out"}};
  for (const auto& [d, why] : cases)
    for (const Method method : {Method::automatic, Method::march, Method::euler, Method::contour, Method::multigrid}) {
      const Result r = solved_by(field(d, 1e-2), method, 64);
      EXPECT_EQ(r.status, Status::unsupported) << to_string(method);
      EXPECT_NE(r.reason.find("E is singular"), std::string::npos) << r.reason;
      EXPECT_NE(r.reason.find(why), std::string::npos) << r.reason;
      EXPECT_EQ(r.reason.find('\n'), std::string::npos);
      EXPECT_TRUE(r.y.bottomRows(64).array().isNaN().all());
    }
}

// The same of dense dynamics, where nothing is known of nodes.
TEST(Fields, ASingularDenseMassIsNamed) {
  DenseDynamics d{-Matrix::Identity(3, 3), Vector::Unit(3, 0), Vector::Unit(3, 0).transpose(), Matrix::Identity(3, 3)};
  Scene scene;
  scene.name = "small";
  scene.M = Matrix::Ones(1, 1);
  scene.x0 = Vector::Zero(3);
  scene.g = [](double, Eigen::Ref<Vector> g) { g.setConstant(-1); };
  scene.T = 1;
  const auto reason = [&](const Matrix& A, const Matrix& E) {
    scene.dynamics = DenseDynamics{A, d.B, d.N, E};
    const Result r = solved_by(scene, Method::march, 8);
    EXPECT_EQ(r.status, Status::unsupported);
    return r.reason;
  };
  Matrix E = Matrix::Identity(3, 3), A = d.A;
  E(1, 1) = 0;
  EXPECT_NE(reason(A, E).find("row 1 of E is zero, an algebraic equation"), std::string::npos);
  E.row(1) = E.row(2);
  A.row(1) = A.row(2);
  EXPECT_NE(reason(A, E).find("so is zE - A for all z"), std::string::npos) << reason(A, E);
  E.bottomRows(2).setZero();
  A.bottomRows(2).setZero();
  EXPECT_NE(reason(A, E).find("row 1, the first of 2, of E and of A is zero"), std::string::npos);
}

// With a mass an isolated node keeps its value, and an isolated contact integrates y.
TEST(Fields, IsolatedNodesWithAMassAreSolved) {
  for (const auto& [node, compliance] : {std::pair<Index, double>{5 * Q + 7, 0}, {3 * Q, 5}}) {
    const Scene scene = field(isolated(node, 1), compliance);
    const Result found = solved_by(scene, Method::march, many_steps),
                 twin = solved_by(dense_twin(scene), Method::march, many_steps);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    ASSERT_EQ(twin.status, Status::solved) << twin.reason;
    ASSERT_EQ(found.continuous, twin.continuous);
    // Weights to 1e-9, whose sum over the steps, 1/(M + W_0) and the constraints on both sides amplify.
    EXPECT_LE((found.y - twin.y).bottomRows(many_steps).cwiseAbs().maxCoeff(), 1e-5 * twin.y.maxCoeff()) << node;
    EXPECT_GT((found.y.array() > 0).count(), 1000);
  }
}

// n = 300 rows are not written out. The march solves problems with M + W_0, the sweeps those of M.
// A node with x' = rate x + y_3, which w_3 sees a little; or one that nothing drives and nobody sees.
SparseDynamics with_a_growing_node(double rate, bool joined) {
  const Index node = m / 2 + 4;
  SparseDynamics d = isolated(node, 1);
  d.A.coeffRef(node, node) = rate;
  if (joined) d.B.coeffRef(node, 3) = 1, d.N.coeffRef(3, node) = 1e-3;
  return d;
}

// Rules that damp all that decays fast damp what grows fast, too: 64 steps of 1/64 do not follow e^(40 t).
TEST(Fields, ModesThatGrowFasterThanTheStepsAreNamed) {
  for (const double compliance : {0.0, 1e-2})
    for (const Method method : {Method::march, Method::euler}) {
      const std::string what = std::string(to_string(method)) + " " + std::to_string(compliance);
      const Result fast = solved_by(field(with_a_growing_node(40, true), compliance), method, 64);
      if (method == Method::march && fast.continuous) {  // weights of exponentials, which need no rule
        EXPECT_EQ(fast.status, Status::solved) << what << fast.reason;
      } else {
        EXPECT_EQ(fast.status, Status::tolerance_not_met) << what;
        EXPECT_NE(fast.reason.find("grows like e^(40 t)"), std::string::npos) << what << fast.reason;
      }
      for (const auto& [rate, joined] : {std::pair(4., true), {40., false}}) {
        const Result slow = solved_by(field(with_a_growing_node(rate, joined), compliance), method, 64);
        EXPECT_EQ(slow.status, Status::solved) << what << rate << slow.reason;
      }
    }
  SparseDynamics d = heated_square();
  d.E = -unit_mass();
  EXPECT_NE(solved_by(field(d, 0), Method::march, 64).status, Status::solved);
}

TEST(Fields, AContactThatNothingMovesIsNamed) {
  SparseDynamics d = heated_square();
  d.N = (Vector::Ones(Q) - Vector::Unit(Q, 3)).asDiagonal() * d.N;
  d.N.prune(0.0);
  const Result unseen = solved_by(field(d, 0), Method::march, 64);
  EXPECT_EQ(unseen.status, Status::tolerance_not_met);
  EXPECT_NE(unseen.reason.find("row 3 of N and of M is zero"), std::string::npos) << unseen.reason;
}

TEST(Fields, AMatrixOfNoClassIsNamedWhereSweepsNeedIt) {
  constexpr Index n = 300, states = 700;
  SparseDynamics d{SparseMatrix(states, states), SparseMatrix(states, n), SparseMatrix(n, states)};
  for (Index i = 0; i < states; ++i) d.A.insert(i, i) = -1 - double(i) / 20;
  SparseMatrix M(n, n);
  for (Index i = 0; i < n; ++i) {
    d.B.insert(2 * i, i) = 1;
    d.N.insert(i, 2 * i) = 1;
    M.insert(i, i) = 1;
    if (i + 1 < n) M.insert(i, i + 1) = 2;
    if (i > 0) M.insert(i, i - 1) = 3;
  }
  M.insert(0, n - 1) = 1;
  Scene scene;
  scene.name = "no class";
  scene.dynamics = d;
  scene.M = SparseLcpMatrix(M);
  scene.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(0.1 - t); };
  scene.x0 = Vector::Zero(states);
  scene.T = 1;
  try {
    solved_by(scene, Method::contour, 16);
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.argument(), "M");
    EXPECT_NE(std::string(error.what()).find("neither symmetric positive definite nor H+"), std::string::npos);
  }
  // A march says what became of it: a solution with its residual, or where it ended.
  const Result euler = solved_by(scene, Method::euler, 16);
  if (euler.status == Status::solved) {
    EXPECT_LE(euler.residual, 1e-9);
  } else {
    EXPECT_FALSE(euler.reason.empty());
  }
}

// A face of 96 x 96 points. Written out, M has 0.68 GB: the memory that is ever used tells.
Scene on_a_face(const SparseMatrix& M) {
  constexpr Index P = 96;
  const SecondDifference side{P, 1.0 / (P + 1), 0.002};
  KroneckerDynamics d{side, {2, 0.5, 0.1}, Vector::Unit(2, 0), Vector::Unit(2, 0), {side}};
  Scene scene;
  scene.name = "face";
  scene.dynamics = d;
  scene.M = SparseLcpMatrix(M);
  scene.x0 = Vector::Zero(2 * P * P);
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < g.size(); ++i) g[i] = std::sin(6 * t + 0.01 * double(i));
  };
  scene.f_entry = SourceEntry::through_B;
  scene.T = 1;
  return scene;
}

// a on the diagonal, `varying` on top of it from point to point, and -b for the neighbours on the face.
SparseMatrix five_points(double a, double varying, double b) {
  constexpr Index P = 96;
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < P * P; ++i) {
    entries.emplace_back(i, i, a + varying * std::sin(double(i)));
    for (const Index stride : {Index(1), P}) {
      if (i / stride % P + 1 == P) continue;
      entries.emplace_back(i, i + stride, -b);
      entries.emplace_back(i + stride, i, -b);
    }
  }
  SparseMatrix M(P * P, P * P);
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

double peak_gigabytes() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  return double(used.ru_maxrss) * 1024 / 1e9;
}

TEST(Fields, SparseMatricesOnFacesAreNeverWrittenOut) {
  const double before = peak_gigabytes();
  constexpr Index steps = 8;
  // A stencil, and an M-matrix that is none.
  for (const SparseMatrix& M : {five_points(3, 0, 0), five_points(6, 1, 1)}) {
    const Scene scene = on_a_face(M);
    const Result r = solved_by(scene, Method::march, steps);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(r.residual, 1e-12);
    EXPECT_GT((r.y.array() > 0).count(), 10000);
    const Result swept = solved_by(scene, Method::automatic, steps);
    ASSERT_EQ(swept.status, Status::solved) << swept.reason;
    EXPECT_LE((swept.y - r.y).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(), 1e-8 * r.y.maxCoeff());
  }
  EXPECT_LE(peak_gigabytes(), std::max(before, 0.5));
}

}  // namespace
}  // namespace bromwich
