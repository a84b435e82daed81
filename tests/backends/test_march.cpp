// Contract of Backend: step-by-step solutions against a loop over the lag table.

#include "tests/backends/march.hpp"

namespace bromwich {
namespace {

INSTANTIATE_TEST_SUITE_P(Contract, BackendMarch, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(BackendMarch, ModalAgainstALoop) {
  // For n = 143 the LCP uses the banded solver and the sine transform has length 144.
  for (const Index n : {1, 3, 8, 9, 39, 143})
    for (const auto& [driven, reflecting] : {std::pair(false, false), {true, false}, {true, true}}) {
      const Index rows = n < 100 ? 50 : 20;
      KroneckerDynamics d = reference::signorini_dynamics(n, 5, 2e-3);
      if (reflecting) d.along.first = 1, d.along.last = 0.4;
      Random random{std::uint32_t(n)};
      ModalRecurrence recurrence = modal_recurrence(d, n % 2 ? Rule::exponential : Rule::implicit_euler, 0.05, {});
      recurrence.w1 = 0.01 * random.vector(n);  // nonzero, as after compression
      recurrence.s1 = 0.01 * random.vector(n);
      const LcpMatrix M = Tridiagonal{-Vector::Ones(n), Vector::Constant(n, 4), -Vector::Ones(n)};
      const RowMatrix r = random.matrix(rows, n), drive = random.matrix(rows, n);
      const Vector y0 = random.vector(n).cwiseAbs();
      const Outcome found = march(M, LcpClass::P, recurrence, r, driven ? &drive : nullptr, y0);
      const Trajectory exact = loop(to_dense(M), lag_table(recurrence, rows - 1), r, driven ? &drive : nullptr, y0);
      EXPECT_LE(distance(found.y, exact.y), same) << n << (driven ? " driven" : "");
      EXPECT_LE(distance(found.v.bottomRows(rows - 1), exact.v.bottomRows(rows - 1)), same)
          << n << (driven ? " driven" : "");
      EXPECT_EQ(found.report.count.solved, rows - 1);
      EXPECT_EQ(found.report.count.unsolved, 0);
      EXPECT_EQ(found.report.stopped, -1);
      EXPECT_EQ(found.report.infeasible, -1);
      EXPECT_TRUE(found.report.finite);
    }
}

TEST_P(BackendMarch, ModalWithAnInitialState) {
  const Index rows = 30, n = 9;
  const KroneckerDynamics d = reference::signorini_dynamics(n, 5, 2e-3);
  Random random(4);
  ModalRecurrence recurrence = modal_recurrence(d, Rule::exponential, 0.05, random.matrix(n, 5));
  const LcpMatrix M = Tridiagonal{-Vector::Ones(n), Vector::Constant(n, 4), -Vector::Ones(n)};
  const RowMatrix r = random.matrix(rows, n);
  const Outcome found = march(M, LcpClass::P, recurrence, r, nullptr, Vector::Zero(n));
  // The same part of v, moved to r by hand: S Σ_k C_k E_k^{j-1} initial_k.
  RowMatrix moved = RowMatrix::Zero(rows, n), part = recurrence.output.cwiseProduct(recurrence.initial);
  for (Index j = 1; j < rows; ++j, part = part.cwiseProduct(recurrence.decay))
    moved.row(j) = part.colwise().sum() * reference::sine_matrix(n);
  recurrence.initial.resize(0, 0);
  const Trajectory exact = loop(to_dense(M), lag_table(recurrence, rows - 1), r + moved, nullptr, Vector::Zero(n));
  EXPECT_LE(distance(found.y, exact.y), same);
  EXPECT_LE(distance(found.v.bottomRows(rows - 1), (exact.v + moved).bottomRows(rows - 1)), same);
}

TEST_P(BackendMarch, StopsWhereNothingSolves) {
  const Index rows = 12;
  // Almost no dynamics: the rows are LCP(M, r_j) up to 1e-9.
  const DenseDynamics d{Matrix{{-1}}, Matrix::Constant(1, 2, 1e-9), Matrix::Ones(2, 1)};
  const Recurrence recurrence = dense_recurrence(d, Rule::exponential, 0.1);
  const LcpMatrix fold = Matrix{{1, -2}, {-2, 1}};
  RowMatrix r = Eigen::RowVector2d(-1, 3).replicate(rows, 1);
  r(7, 1) = 1.9;
  const Outcome infeasible = march(fold, LcpClass::Z, recurrence, r, nullptr, Vector{{1, 0}});
  EXPECT_EQ(infeasible.report.infeasible, 7);
  EXPECT_EQ(infeasible.report.count.solved, 6);
  EXPECT_LE(distance(infeasible.y.topRows(7), Eigen::RowVector2d(1, 0).replicate(7, 1)), 1e-7);  // 1e-9, a few steps
  EXPECT_TRUE(infeasible.y.bottomRows(rows - 7).array().isNaN().all());
  EXPECT_TRUE(infeasible.v.bottomRows(rows - 7).array().isNaN().all());
  EXPECT_TRUE(infeasible.report.finite);

  r(7, 1) = 3;
  r(4, 0) = std::numeric_limits<double>::quiet_NaN();
  const Outcome broken = march(fold, LcpClass::Z, recurrence, r, nullptr, Vector{{1, 0}});
  EXPECT_FALSE(broken.report.finite);
  EXPECT_EQ(broken.report.stopped, 4);
  EXPECT_EQ(broken.report.infeasible, -1);
  EXPECT_TRUE(broken.y.topRows(4).allFinite());
  EXPECT_TRUE(broken.y.bottomRows(rows - 4).array().isNaN().all());
}

/// One plan that is run repeatedly, and its input arrays.
struct ModalCase {
  ModalCase(Index n, Index rows, bool driven)
      : M(Tridiagonal{-Vector::Ones(n), Vector::Constant(n, 4), -Vector::Ones(n)}),
        recurrence(modal_recurrence(reference::signorini_dynamics(n, 5, 2e-3), Rule::exponential, 0.05, {})),
        drive(driven ? RowMatrix(Random(7).matrix(rows, n)) : RowMatrix()) {}

  MarchProblem on(const Array& r, const Array* drive_array) const {
    MarchProblem problem;
    problem.M = &M;
    problem.lcp_class = LcpClass::P;
    problem.recurrence = &recurrence;
    problem.r = &r;
    problem.drive = drive_array;
    return problem;
  }

  LcpMatrix M;
  Recurrence recurrence;
  RowMatrix drive;
};

/// r with independent rows: about half of all signs change from row to row. Row 0 holds y_0.
RowMatrix unrelated_rows(Index rows, Index n, unsigned seed) {
  Random random(seed);
  return 3 * random.matrix(rows, n);
}

/// The same by one CPU thread.
struct Reference {
  Reference(const ModalCase& c, const RowMatrix& r, const RowMatrix& start) {
    const auto cpu = make_cpu_backend(1);
    const auto r_array = cpu->array(r.rows(), r.cols()), y_array = cpu->array(r.rows(), r.cols()),
               v_array = cpu->array(r.rows(), r.cols()), drive_array = cpu->array(r.rows(), r.cols());
    cpu->upload(r, *r_array);
    cpu->upload(start, *y_array);
    if (c.drive.size() > 0) cpu->upload(c.drive, *drive_array);
    report =
        cpu->march(c.on(*r_array, c.drive.size() > 0 ? drive_array.get() : nullptr), r.rows())->run(*y_array, *v_array);
    cpu->download(*y_array, y);
    cpu->download(*v_array, v);
  }
  MarchReport report;
  RowMatrix y, v;
};

/// max |min(y, M y + r + v)| over the rows j >= 1.
double natural_residual(const ModalCase& c, const RowMatrix& r, const RowMatrix& y, const RowMatrix& v) {
  const RowMatrix w = y * to_dense(c.M).transpose() + r + v;
  return y.cwiseMin(w).bottomRows(y.rows() - 1).cwiseAbs().maxCoeff();
}

/// n eps for the sums of a step times the growth e^4 (as above), for n up to 1000 and entries up to ten.
constexpr double alike = 1e-11;

// Sizes around those at which kernels change, one step and many. Each plan runs twice: the state kept from the first
// run must not affect the second.
TEST_P(BackendMarch, ModalSizesRunTwice) {
  for (const auto& [n, rows] : {std::pair<Index, Index>{1, 2},
                                {1, 40},
                                {2, 40},
                                {33, 2},
                                {64, 30},
                                {65, 17},
                                {65, 18},
                                {65, 120},
                                {130, 40},
                                {511, 6},
                                {513, 4},
                                {900, 3}})
    for (const bool driven : {false, true}) {
      const ModalCase c(n, rows, driven);
      const auto r_array = backend->array(rows, n), y_array = backend->array(rows, n),
                 v_array = backend->array(rows, n);
      const auto drive_array = driven ? device(c.drive) : nullptr;
      const auto plan = backend->march(c.on(*r_array, drive_array.get()), rows);
      for (const unsigned run : {1u, 2u, 3u}) {
        // The third run begins like the second, with the same active set in its first rows.
        const RowMatrix r = unrelated_rows(rows, n, run);
        RowMatrix start = RowMatrix::Zero(rows, n), y, v;
        if (run > 1) start.row(0) = unrelated_rows(1, n, 17).cwiseMax(0);
        backend->upload(r, *r_array);
        backend->upload(start, *y_array);
        const MarchReport report = plan->run(*y_array, *v_array);
        backend->download(*y_array, y);
        backend->download(*v_array, v);
        const Reference exact(c, r, start);
        EXPECT_LE(distance(y, exact.y), alike) << n << (driven ? " driven" : "") << ", run " << run;
        EXPECT_LE(distance(v.bottomRows(rows - 1), exact.v.bottomRows(rows - 1)), alike) << n << ", run " << run;
        EXPECT_LE(natural_residual(c, r, y, v), alike) << n << ", run " << run;
        EXPECT_EQ(report.count.solved, rows - 1);
        EXPECT_EQ(report.stopped, -1);
        EXPECT_TRUE(report.well_posed);
      }
    }
}

// Reporting progress does not change the steps.
TEST_P(BackendMarch, ModalInPiecesAndInterrupted) {
  const Index n = 11, rows = 1200;
  const ModalCase c(n, rows, true);
  const RowMatrix r = unrelated_rows(rows, n, 5), start = RowMatrix::Zero(rows, n);
  const Reference exact(c, r, start);
  const auto r_array = device(r), drive_array = device(c.drive), v_array = backend->array(rows, n);
  MarchProblem problem = c.on(*r_array, drive_array.get());
  std::vector<Index> heard;
  problem.progress = [&](Index j) { heard.push_back(j); };
  RowMatrix y;
  const auto y_array = device(start);
  const MarchReport report = backend->march(problem, rows)->run(*y_array, *v_array);
  backend->download(*y_array, y);
  EXPECT_LE(distance(y, exact.y), alike);
  EXPECT_EQ(report.count.solved, rows - 1);
  EXPECT_GE(heard.size(), 2u);
  EXPECT_TRUE(std::is_sorted(heard.begin(), heard.end()));

  problem.interrupted = [&] { return true; };
  const MarchReport ended = backend->march(problem, rows)->run(*y_array, *v_array);
  backend->download(*y_array, y);
  EXPECT_TRUE(ended.interrupted);
  ASSERT_GT(ended.stopped, 0);
  ASSERT_LT(ended.stopped, rows);
  EXPECT_EQ(ended.count.solved, ended.stopped - 1);
  EXPECT_LE(distance(y.topRows(ended.stopped), exact.y.topRows(ended.stopped)), alike);
  EXPECT_TRUE(y.bottomRows(rows - ended.stopped).array().isNaN().all());
  EXPECT_TRUE(host(*v_array).bottomRows(rows - ended.stopped).array().isNaN().all());
}

// Semismooth Newton cycles for this P-matrix at q = -1 from the set {0}, to which q = (-1, 5, 5) leads. The dynamics
// add 1e-9.
TEST_P(BackendMarch, ModalEndsWhereNewtonCycles) {
  const Index n = 3, rows = 9;
  ModalRecurrence weak = modal_recurrence(reference::signorini_dynamics(n, 5, 2e-3), Rule::exponential, 0.05, {});
  weak.output *= 1e-9;
  for (Vector* w : {&weak.w0, &weak.w1, &weak.s1}) *w *= 1e-9;
  const LcpMatrix cycling = Matrix{{1, 0, 2}, {2, 1, 0}, {0, 2, 1}};
  RowMatrix r = RowMatrix::Constant(rows, n, -1), exact = RowMatrix::Constant(rows, n, 1.0 / 3);
  for (Index j = 0; j < rows; j += 2) {
    r.row(j) = Eigen::RowVector3d(-1, 5, 5);
    exact.row(j) = Eigen::RowVector3d(1, 0, 0);
  }
  const Outcome found = march(cycling, LcpClass::P, weak, r, nullptr, exact.row(0).transpose());
  EXPECT_LE(distance(found.y, exact), 1e-7);  // 1e-9, some ten weights and ||M^{-1}|| <= 1
  EXPECT_EQ(found.report.count.solved, rows - 1);
  EXPECT_GE(found.report.count.fallbacks, 1);
  EXPECT_EQ(found.report.stopped, -1);
}

TEST_P(BackendMarch, ModalStopsAtWhatIsNotFinite) {
  const Index n = 9, rows = 20;
  const ModalCase c(n, rows, false);
  RowMatrix r = unrelated_rows(rows, n, 5);
  r(6, 3) = std::numeric_limits<double>::infinity();
  const Outcome found = march(c.M, LcpClass::P, c.recurrence, r, nullptr, Vector::Zero(n));
  EXPECT_FALSE(found.report.finite);
  EXPECT_EQ(found.report.stopped, 6);
  EXPECT_EQ(found.report.count.solved, 5);
  EXPECT_TRUE(found.y.topRows(6).allFinite());
  EXPECT_TRUE(found.y.bottomRows(rows - 6).array().isNaN().all());
}

}  // namespace
}  // namespace bromwich
