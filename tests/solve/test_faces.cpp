// Contact on a face of a box: Kronecker sums of three factors, stencils, shells of exponentials, the problem of a step,
// and signorini3d by all methods.

#include "catalogue/catalogue.hpp"
#include "core/dynamics/second_difference.hpp"
#include "core/host/face_lcp.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/kernel/shells.hpp"
#include "core/kernel/weights.hpp"
#include "core/lcp/stencil.hpp"
#include "core/numerics/sine_basis.hpp"
#include "core/solve/solve.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

using reference::Random;

/// a I + b_d (neighbours in direction d), entry by entry.
SparseMatrix written_stencil(const Stencil& s) {
  Index n = 1;
  for (const Index extent : s.extents) n *= extent;
  Matrix M = s.centre * Matrix::Identity(n, n);
  Index stride = n;
  for (std::size_t d = 0; d < s.extents.size(); ++d) {
    stride /= s.extents[d];
    for (Index i = 0; i < n; ++i)
      if (i / stride % s.extents[d] + 1 < s.extents[d]) M(i, i + stride) = M(i + stride, i) = s.beside[d];
  }
  return M.sparseView();
}

std::vector<Stencil> stencils() {
  return {{{4, 7}, 6, {-1, -1}}, {{5, 3}, 4, {-0.7, -1.1}}, {{2, 3, 4}, 7, {-1, -0.5, -2}}};
}

TEST(Stencil, IsFoundAndDiagonalInSineModes) {
  for (const Stencil& s : stencils()) {
    const SparseMatrix M = written_stencil(s);
    const auto found = stencil_of(SparseLcpMatrix(M), s.extents);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->centre, s.centre);
    EXPECT_EQ(found->beside, s.beside);
    const Matrix S = FaceBasis(s.extents).matrix(), D = S * Matrix(M) * S;
    EXPECT_LE((D - Matrix(found->eigenvalues().asDiagonal())).cwiseAbs().maxCoeff(), 1e-13);
    // The largest eigenvalue of I - M/a.
    const Matrix jacobi = Matrix::Identity(M.rows(), M.rows()) - Matrix(M) / s.centre;
    EXPECT_NEAR(found->jacobi_radius(), Eigen::SelfAdjointEigenSolver<Matrix>(jacobi).eigenvalues().maxCoeff(), 1e-13);
  }
}

TEST(Stencil, IsNotFoundWhereAnEntryDiffers) {
  const Stencil s{{4, 5}, 6, {-1, -1}};
  for (const auto& [row, column] :
       {std::pair(0, 0), std::pair(3, 4), std::pair(4, 5), std::pair(19, 18), std::pair(2, 9)}) {
    Matrix M = written_stencil(s);
    M(row, column) += 0.5;
    EXPECT_FALSE(stencil_of(SparseLcpMatrix(M.sparseView()), s.extents)) << row << ' ' << column;
  }
  EXPECT_FALSE(stencil_of(SparseLcpMatrix(written_stencil(s)), {5, 4}));
  EXPECT_FALSE(stencil_of(SparseLcpMatrix(written_stencil(s)), {20}));
}

TEST(FaceModes, AreTheProductsOfSineMatrices) {
  Vector v = Random(3).vector(4 * 3 * 5);
  const FaceBasis basis{4, 3, 5};
  const Vector expected = basis.matrix() * v;
  basis.apply(Way::to_modes, v.data());
  EXPECT_LE((v - expected).cwiseAbs().maxCoeff(), 1e-14);
}

/// The first problem of a row of random ones, by pivoting with the dense M + W_0.
TEST(FaceLcp, SolvesTheProblemOfAStep) {
  for (const Stencil& s : stencils()) {
    const SparseMatrix M = written_stencil(s);
    const Index n = M.rows();
    const Matrix S = FaceBasis(s.extents).matrix();
    const Vector w0 = Vector::LinSpaced(n, -0.8, -0.1);
    const auto lcp = host::FaceLcp::make(SparseLcpMatrix(M), s.extents, w0, [&](Way, const double* in, double* out) {
      Eigen::Map<Vector>(out, n) = S * Eigen::Map<const Vector>(in, n);
    });
    ASSERT_TRUE(lcp);
    const Matrix implicit = Matrix(M) + S * w0.asDiagonal() * S;
    Random random(11);
    lcp->start_from(Vector::Zero(n));
    for (int step = 0; step < 5; ++step) {
      const Vector q = 3 * random.vector(n);
      Vector y;
      ASSERT_TRUE(lcp->solve(q, y).solved);
      Vector exact;
      ASSERT_TRUE(ActiveSetLcp(implicit, LcpClass::P).solve(q, exact).solved);
      EXPECT_LE((y - exact).cwiseAbs().maxCoeff(), 1e-13);
    }
    Vector unknown;
    EXPECT_FALSE(lcp->solve(Vector::Constant(n, NAN), unknown).solved);
  }
  const Stencil s = stencils()[0];
  const auto unused = [](Way, const double*, double*) {};
  const Vector all = Vector::Constant(28, -5);  // M + W_0 is not positive definite
  EXPECT_FALSE(host::FaceLcp::make(SparseLcpMatrix(written_stencil(s)), s.extents, all, unused));
}

Options on(Method method, Index steps) {
  Options options;
  options.method = method;
  options.steps = steps;
  return options;
}

// All eigenvalues of a line, on a face where most modes decay within a few steps.
TEST(Shells, KeepTheWeightsWithFewerRates) {
  KroneckerDynamics d{{15, 1 / 16., 0.5}, {24, 1 / 25., 0.02}, Vector::Unit(24, 0), -Vector::Unit(24, 0)};
  d.beside = {{16, 1 / 17., 0.5}};
  const Index J = 256;
  const ModalRecurrence given = modal_recurrence(d, Rule::exponential, 2.0 / double(J), RowMatrix());
  const Shells shells = find_shells(HostThreads(), given, J, 16, 4);
  const ModalRecurrence fewer = in_shells(given, shells);
  EXPECT_LE(shells.error, 1e-11);
  const Index groups = Index(shells.of_group.size());
  Index kept = 0;
  for (Index g = 0; g < groups; ++g) kept += shells.kept(g);
  EXPECT_LT(kept, 24 * groups * 3 / 4);
  for (Index g = 0; g < groups; ++g)
    EXPECT_TRUE(fewer.output.block(shells.kept(g), g * 16, 24 - shells.kept(g), 16).isZero(0));
  const LagTable a = lag_table(given, J), b = lag_table(fewer, J);
  // Each lag weighs the kernel on two steps: twice the error of the fit, relative to the largest lag.
  const double scale = a.W.cwiseAbs().maxCoeff();
  EXPECT_LE((a.W - b.W).cwiseAbs().maxCoeff(), 1e-10 * scale);
  EXPECT_LE((a.S - b.S).cwiseAbs().maxCoeff(), 1e-10 * scale);
}

// The sums and differences of two faces have amplitudes of their own. 135 modes of each are no whole groups of 16.
TEST(Shells, FitEachFamilyAlone) {
  KroneckerDynamics d{{15, 1 / 16., 0.5}, {24, 1 / 25., 0.02}, Vector::Unit(24, 0), -Vector::Unit(24, 0)};
  d.beside = {{9, 1 / 17., 0.5}};
  d.both_faces = true;
  const Index J = 256;
  const ModalRecurrence given = modal_recurrence(d, Rule::exponential, 2.0 / double(J), RowMatrix());
  const Shells shells = find_shells(HostThreads(), given, J, 16, 4);
  EXPECT_LE(shells.error, 1e-11);
  EXPECT_LT(shells.kept(0), 24);
  EXPECT_EQ(shells.kept(135 / 16), 24) << "the group of both families";
  const LagTable a = lag_table(given, J), b = lag_table(in_shells(given, shells), J);
  EXPECT_LE((a.W - b.W).cwiseAbs().maxCoeff(), 1e-10 * a.W.cwiseAbs().maxCoeff());
  EXPECT_LE((a.S - b.S).cwiseAbs().maxCoeff(), 1e-10 * a.W.cwiseAbs().maxCoeff());
}

// Coarse grids have the families of the finer one.
TEST(Shells, OfCoarseGridsFitEachFamily) {
  KroneckerDynamics d{{15, 1 / 16., 0.5}, {24, 1 / 25., 0.02}, Vector::Unit(24, 0), -Vector::Unit(24, 0)};
  d.beside = {{9, 1 / 17., 0.5}};
  d.both_faces = true;
  const Index J = 128;
  const ModalRecurrence coarse = coarsen(modal_recurrence(d, Rule::exponential, 1.0 / double(J), RowMatrix()));
  EXPECT_EQ(coarse.families, 2);
  const LagTable a = lag_table(coarse, J),
                 b = lag_table(in_shells(coarse, find_shells(HostThreads(), coarse, J, 16, 4)), J);
  EXPECT_LE((a.W - b.W).cwiseAbs().maxCoeff(), 1e-10 * a.W.cwiseAbs().maxCoeff());
  EXPECT_LE((a.S - b.S).cwiseAbs().maxCoeff(), 1e-10 * a.W.cwiseAbs().maxCoeff());
}

class Faces : public BackendTest {};

// With sine modes, others, and both.
std::vector<FaceBasis> bases() {
  const auto reflecting = [](Index n, double first, double last) {
    return LineBasis{n, std::make_shared<const Matrix>(SecondDifference{n, 1. / double(n), 1, first, last}.modes())};
  };
  std::vector<FaceBasis> all{{15, 15}, {31, 15}, {15, 127}, {5, 8}, {1, 7}, {3, 4, 5}, {12}};
  for (const Index n : {1, 2, 13, 64}) all.emplace_back(std::vector<LineBasis>{reflecting(n, 1, 0.3)});
  all.emplace_back(std::vector<LineBasis>{reflecting(15, 1, 1), {15}});
  all.emplace_back(std::vector<LineBasis>{reflecting(5, 1, 1), reflecting(8, 0.2, 0)});
  all.emplace_back(std::vector<LineBasis>{{3}, reflecting(4, 1, 0), {5}});
  return all;
}

INSTANTIATE_TEST_SUITE_P(Contract, Faces, testing::ValuesIn(backend_cases()), backend_case_name);

// Two directions, with and without 2^k - 1 points, and three.
TEST_P(Faces, TransformEqualsTheDenseMatrix) {
  for (const FaceBasis& basis : bases())
    for (const auto& [rows, way] :
         {std::pair<Index, Way>{1, Way::to_modes}, {1, Way::to_points}, {6, Way::to_modes}, {70, Way::to_points}}) {
      const Matrix V = basis.matrix(), S = way == Way::to_modes ? V : Matrix(V.transpose());
      const Index n = S.rows();
      const RowMatrix values = Random(std::uint32_t(n)).matrix(rows, n), addend = Random(9).matrix(rows, n);
      const RowMatrix exact = values * S;
      const double tolerance = 8 * epsilon * std::sqrt(double(n));
      const auto in = device(values), add = device(addend), out = device(addend);
      const auto transform = backend->face_transform(basis, rows, way);
      transform->apply(*in, nullptr, *out, rows - 1);
      EXPECT_LE((host(*out).bottomRows(1) - exact.bottomRows(1)).cwiseAbs().maxCoeff(), tolerance);
      EXPECT_EQ(host(*out).topRows(rows - 1), addend.topRows(rows - 1));
      transform->apply(*in, nullptr, *out, 0);
      EXPECT_LE((host(*out) - exact).cwiseAbs().maxCoeff(), tolerance);
      transform->apply(*in, add.get(), *out, 0);
      EXPECT_LE((host(*out) - addend - exact).cwiseAbs().maxCoeff(), tolerance);
      transform->apply(*in, add.get(), *add, 0);
      EXPECT_LE((host(*add) - addend - exact).cwiseAbs().maxCoeff(), tolerance);
      EXPECT_EQ(host(*in), values);
    }
}

// Many faces of 127 x 127 points, which a device takes in another way, and large ones; each differs. Sums of N terms in
// both directions.
TEST_P(Faces, TransformManyFaces) {
  for (const auto& [Q, many] : {std::pair<Index, Index>{127, 301}, {255, 40}, {255, 3}, {511, 12}}) {
    const Index rows = GetParam().name == "cuda" ? many : 2;
    const Matrix S = sine_matrix(Q);
    const RowMatrix values = Random(5).matrix(rows, Q * Q);
    const auto in = device(values), out = device(RowMatrix::Constant(rows, Q * Q, NAN));
    backend->face_transform({Q, Q}, rows, Way::to_modes)->apply(*in, nullptr, *out, 0);
    const RowMatrix found = host(*out);
    for (Index j = 0; j < rows; j = j + 2 < rows ? j + 37 : rows) {
      const Eigen::Map<const RowMatrix> X(values.row(j).data(), Q, Q), Y(found.row(j).data(), Q, Q);
      EXPECT_LE((S * X * S - Y).cwiseAbs().maxCoeff(), 8 * epsilon * double(Q)) << Q << ' ' << j;
    }
    EXPECT_TRUE(found.allFinite());
  }
}

// Repeated sweeps end at the solution without the shift, which a batch keeps.
TEST_P(Faces, ProjectedSweepsEndAtTheSolution) {
  for (const Stencil& s : {Stencil{{9, 6}, 6, {-1, -1}}, Stencil{{15, 31}, 5, {-0.6, -1.2}}}) {
    const SparseMatrix M = written_stencil(s);
    const Index n = M.rows(), rows = 5;
    const RowMatrix q = 2 * Random(4).matrix(rows, n);
    const auto r = device(q), v = device(RowMatrix::Zero(rows, n)), y = device(RowMatrix::Zero(rows, n));
    for (const double D : {0.0, -0.3}) {
      ProjectedSweeps sweeps{&M, D, best_relaxation(s.shifted(D)), 2, s.extents};
      const auto batch = backend->projected_sweeps(sweeps, LcpClass::P, rows);
      LcpReport report;
      for (int k = 0; k < 60; ++k) report = batch->solve(*r, *v, *y, 1);
      EXPECT_EQ(report.count.unsolved, 0);
      EXPECT_LE(report.change, 1e-13);
      const RowMatrix found = host(*y);
      EXPECT_EQ(found.row(0), RowMatrix::Zero(1, n)) << "rows before the first are left";
      const auto exact = backend->lcp(SparseLcpMatrix(M), LcpClass::P, rows);
      const auto solved = device(RowMatrix::Zero(rows, n));
      EXPECT_EQ(exact->solve(*r, *v, *solved, 1).count.unsolved, 0);
      EXPECT_LE((host(*solved) - found).bottomRows(rows - 1).cwiseAbs().maxCoeff(), 1e-13);
      for (Index j = 1; j < rows; ++j) {
        const Vector w = M * found.row(j).transpose() + q.row(j).transpose();
        EXPECT_LE(w.cwiseMin(found.row(j).transpose()).cwiseAbs().maxCoeff(), 1e-12);
      }
    }
  }
}

// A device divides the lines of a face among several blocks where faces are few: y and what is reported are the same.
TEST_P(Faces, SweepsOfFewFacesAreThoseOfMany) {
  if (GetParam().name == "reference") GTEST_SKIP() << "solves exactly instead of sweeping";
  for (const Stencil& s :
       {Stencil{{63, 40}, 5, {-0.6, -1.2}}, Stencil{{70, 20}, 4.5, {-1, -1}}, Stencil{{17, 20}, 5, {-1, -1}}})
    for (const Index count : {1, 2}) {
      const SparseMatrix M = written_stencil(s);
      const Index n = M.rows(), few = 3, many = GetParam().name == "cuda" ? 3000 : 6;
      const RowMatrix q = 2 * Random(6).matrix(few, n), start = Random(7).matrix(few, n).cwiseAbs();
      const auto solved = [&](Index rows) {
        const auto r = device(q.replicate(rows / few, 1)), v = device(RowMatrix::Zero(rows, n));
        const auto y = device(start.replicate(rows / few, 1));
        const auto batch = backend->projected_sweeps({&M, -0.3, 1.4, int(count), s.extents}, LcpClass::P, rows);
        LcpReport report;
        for (int k = 0; k < 3; ++k) report = batch->solve(*r, *v, *y, 0);
        return std::pair(host(*y), report.change);
      };
      const auto [y, change] = solved(few);
      const auto [all, change_of_all] = solved(many);
      EXPECT_EQ(all, y.replicate(many / few, 1)) << n << ' ' << count;
      EXPECT_EQ(change, change_of_all);
      EXPECT_GT(change, 1e-6) << "the sweeps have not ended, or nothing is compared";
    }
}

// w of the whole state, 125 numbers that the matrix exponential steps: no modes, no fit, no transform.
TEST_P(Faces, SignoriniAgreesWithTheWholeState) {
  const Scene scene = make_scene("signorini3d", {{"Q", 5}});
  const Index J = 64;
  Scene written = scene;
  const oracle::DenseScene dense = oracle::write_out(scene);
  written.dynamics = DenseDynamics{dense.A, dense.B, dense.N};
  written.M = dense.M;
  written.f_entry = scene.f_entry;
  const Result whole = solve(written, *make_cpu_backend(1), on(Method::march, J));
  ASSERT_EQ(whole.status, Status::solved) << whole.reason;
  for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
    const Result r = solve(scene, *backend, on(method, J));
    ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
    EXPECT_LE((r.y - whole.y).cwiseAbs().maxCoeff(), 1e-11) << to_string(method);
  }
}

// Values that an independent program found, with other fits of the kernel (to 1e-12).
TEST_P(Faces, SignoriniHasItsProbes) {
  if (GetParam().name == "reference" || GetParam().name == "cpu7") GTEST_SKIP() << "the other backends suffice";
  const Scene scene = make_scene("signorini3d", {{"Q", 15}});
  for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::automatic}) {
    const Result r = solve(scene, *backend, on(method, 64));
    ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
    EXPECT_NEAR(r.y(64, 7 * 15 + 7), 0.5849825547, 1e-9) << to_string(method);
    EXPECT_NEAR(r.y(64, 7 * 15 + 4), 1.6136604426, 1e-9) << to_string(method);
  }
}

// The work to a twentieth of the discretisation error, in units of the finest grid: 13 applications of K and 26 passes.
TEST(Signorini3d, CyclesDoLittleWork) {
  const auto backend = make_cpu_backend(2);
  const Scene scene = make_scene("signorini3d", {{"Q", 15}});
  Options options = on(Method::multigrid, 128);
  const Result exact = solve(scene, *backend, options);
  options.tuning.algebraic_share = 0.05;
  const Result r = solve(scene, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(r.convolutions, 13);
  EXPECT_LE(r.passes, 26);
  ASSERT_TRUE(exact.error_estimate);
  EXPECT_LE((r.y - exact.y).cwiseAbs().maxCoeff(), 0.05 * *exact.error_estimate * exact.y.maxCoeff());
}

// States of the modes against the whole state.
TEST(Signorini3d, HasItsStates) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = make_scene("signorini3d", {{"Q", 4}});
  Scene written = scene;
  const oracle::DenseScene dense = oracle::write_out(scene);
  written.dynamics = DenseDynamics{dense.A, dense.B, dense.N};
  written.M = dense.M;
  Options options = on(Method::march, 32);
  options.states = StateSelection::all;
  const Result a = solve(scene, *backend, options), b = solve(written, *backend, options);
  ASSERT_EQ(a.x.cols(), 64);
  EXPECT_LE((a.x - b.x).cwiseAbs().maxCoeff(), 1e-11);
}

}  // namespace
}  // namespace bromwich
