// Lag tables of recurrences against dense weights, the implicit Euler formula and the printed matrices of the paper.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/kernel/memory_length.hpp"
#include "core/kernel/recurrence.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

namespace bromwich {
namespace {

using reference::signorini_dynamics;

Matrix block(const LagTable& table, const RowMatrix& rows, Index lag) {
  return Eigen::Map<const RowMatrix>(rows.row(lag).data(), table.outputs, table.inputs);
}

/// Dense W_d of a modal table: S diag S.
Matrix from_modes(const RowMatrix& rows, Index lag) {
  const Matrix S = reference::sine_matrix(rows.cols());
  return S * rows.row(lag).asDiagonal() * S;
}

oracle::DenseScene dense_scene(const DenseDynamics& d) {
  oracle::DenseScene s;
  s.A = d.A;
  s.B = d.B;
  s.N = d.N;
  return s;
}

TEST(DenseRecurrence, ExponentialRuleAgainstQuadrature) {
  for (const auto& [m, n] : {std::pair<Index, Index>{1, 1}, {2, 5}, {7, 3}, {8, 8}}) {
    reference::Random random(std::uint32_t(10 * m + n));
    const DenseDynamics d{random.matrix(m, m) - Matrix::Identity(m, m), random.matrix(m, n), random.matrix(n, m)};
    const double h = 0.1;
    const Index J = 12;
    const LagTable table = lag_table(dense_recurrence(d, Rule::exponential, h), J);
    for (const oracle::Weights& w :
         {oracle::weights(dense_scene(d), h, J), oracle::quadrature_weights(dense_scene(d), h, J)})
      for (Index lag = 0; lag <= J; ++lag) {
        // Entries of N e^{tA} B, t <= 1.3, stay below m ||e^{tA}|| < 100, weights below 10: some 12 products of them.
        EXPECT_LE((block(table, table.W, lag) - w.W[std::size_t(lag)]).cwiseAbs().maxCoeff(), 1e-13) << m << ' ' << lag;
        EXPECT_LE((block(table, table.S, lag) - w.S[std::size_t(lag)]).cwiseAbs().maxCoeff(), 1e-13) << m << ' ' << lag;
      }
  }
}

TEST(DenseRecurrence, ImplicitEulerPowers) {
  for (const Index m : {1, 3, 8}) {
    reference::Random random{std::uint32_t(m)};
    const DenseDynamics d{random.matrix(m, m) - Matrix::Identity(m, m), random.matrix(m, 2), random.matrix(2, m)};
    const double h = 0.05;
    const Index J = 20;
    const LagTable table = lag_table(dense_recurrence(d, Rule::implicit_euler, h), J);
    const Eigen::FullPivLU<Matrix> lu(Matrix::Identity(m, m) - h * d.A);
    Matrix right = h * d.B;
    for (Index lag = 0; lag <= J; ++lag) {
      right = lu.solve(right).eval();
      // 21 well-conditioned solves with values below 1.
      EXPECT_LE((block(table, table.W, lag) - d.N * right).cwiseAbs().maxCoeff(), 1e-14 * double(m)) << lag;
      EXPECT_EQ(block(table, table.S, lag).cwiseAbs().maxCoeff(), 0) << "y_0 has no effect";
    }
  }
}

TEST(DenseRecurrence, RefusesASingularEulerStep) {
  const DenseDynamics d{Matrix{{2.0}}, Matrix{{1.0}}, Matrix{{1.0}}};
  EXPECT_THROW(dense_recurrence(d, Rule::implicit_euler, 0.5), Error);
  EXPECT_NO_THROW(dense_recurrence(d, Rule::exponential, 0.5));
}

TEST(ModalRecurrence, EqualsTheDenseRecurrence) {
  for (const auto& [along, across] : {std::pair<Index, Index>{1, 1}, {3, 5}, {7, 4}, {8, 1}})
    for (const Rule rule : {Rule::exponential, Rule::implicit_euler}) {
      reference::Random random{std::uint32_t(along)};
      KroneckerDynamics d = signorini_dynamics(along, across, 0.05);
      d.b = random.vector(across);
      d.n = random.vector(across);
      const double h = 0.1;
      const Index J = 15;
      const LagTable modal = lag_table(modal_recurrence(d, rule, h, {}), J);
      const LagTable dense = lag_table(dense_recurrence(to_dense(Dynamics(d)), rule, h), J);
      for (Index lag = 0; lag <= J; ++lag) {
        // Decaying powers; the dense side rounds in products of size 40 with values below h ||b|| ||n|| < 1.
        EXPECT_LE((from_modes(modal.W, lag) - block(dense, dense.W, lag)).cwiseAbs().maxCoeff(), 1e-13) << lag;
        EXPECT_LE((from_modes(modal.S, lag) - block(dense, dense.S, lag)).cwiseAbs().maxCoeff(), 1e-13) << lag;
      }
    }
}

TEST(ModalRecurrence, WeightsInExtendedPrecision) {
  for (const Index Q : {1, 39, 64}) {
    const KroneckerDynamics d = signorini_dynamics(Q, Q);
    const double h = 0.01;
    const LagTable table = lag_table(modal_recurrence(d, Rule::exponential, h, {}), 200);
    const LagTable exact = reference::modal_weights(d, h, 200);
    // Powers of a decay <= 1 have an error of eps per lag where they matter (d e^{-d|x|} d |x| <= 1/e): far below
    // 1e-14.
    const double tolerance = 1e-14 * exact.W.cwiseAbs().maxCoeff();
    EXPECT_LE(distance(table.W, exact.W), tolerance) << Q;
    EXPECT_LE(distance(table.S, exact.S), tolerance) << Q;
  }
}

TEST(MemoryLengths, LeaveOutLessThanARounding) {
  const Index J = 600;
  for (const double h : {1e-3, 0.01, 0.3}) {
    const Recurrence recurrence = modal_recurrence(signorini_dynamics(60, 9, 2e-3), Rule::exponential, h, {});
    const auto& r = std::get<ModalRecurrence>(recurrence);
    const std::vector<Index> lengths = memory_lengths(r, J);
    const LagTable table = lag_table(recurrence, J);
    Index shortened = 0;
    for (Index l = 0; l < 60; ++l) {
      const Index D = lengths[std::size_t(l)], left = J - D;
      ASSERT_GE(D, 1);
      ASSERT_LE(D, J);
      const double kernel = table.W.col(l).cwiseAbs().sum();
      EXPECT_LE(table.W.col(l).tail(left).cwiseAbs().sum(), epsilon / 2 * kernel) << h << ' ' << l;
      EXPECT_LE(table.S.col(l).tail(left).cwiseAbs().sum(), epsilon / 2 * kernel) << h << ' ' << l;
      // The bound uses one exponential: at most 20 % and one lag too long.
      const Index needed = std::max<Index>(Index(0.8 * double(D)) - 1, 0);
      EXPECT_TRUE(D == J || table.W.col(l).tail(J - needed).cwiseAbs().sum() > epsilon / 2 * kernel) << h << ' ' << l;
      shortened += D < J;
    }
    EXPECT_GE(shortened, h == 0.3 ? 50 : h == 0.01 ? 20 : 0) << h;
  }
}

TEST(MemoryLengths, OfWhatDoesNotDecayAreAll) {
  Recurrence recurrence = modal_recurrence(signorini_dynamics(3, 2, 1), Rule::exponential, 1, {});
  auto& r = std::get<ModalRecurrence>(recurrence);
  r.decay(1, 0) = 1;
  r.decay(0, 1) = -1.5;
  EXPECT_EQ(memory_lengths(r, 70)[0], 70);
  EXPECT_EQ(memory_lengths(r, 70)[1], 70);
  EXPECT_LT(memory_lengths(r, 70)[2], 70);
  r.initial = RowMatrix::Ones(2, 3);
  EXPECT_EQ(memory_lengths(r, 70)[2], 70);
  r.initial.resize(0, 0);
  r.output.setZero();  // only W_0, w1 and s1 are left
  EXPECT_EQ(memory_lengths(r, 70)[2], 1);
  r.w0[2] = INFINITY;
  EXPECT_EQ(memory_lengths(r, 70)[2], 70);
}

/// The part of v that x0 adds, seen in modes: Σ_k C_k E_k^{j-1} initial_k.
void expect_initial_response(const KroneckerDynamics& d, Rule rule) {
  const Index n = d.along.points, K = d.across.points, J = 10;
  const Vector x0 = reference::Random(2).vector(n * K);
  const Matrix S = reference::sine_matrix(n), across = reference::sine_matrix(K);
  const RowMatrix modes = S * Eigen::Map<const RowMatrix>(x0.data(), n, K) * across;
  const double h = 0.1;
  const ModalRecurrence r = modal_recurrence(d, rule, h, modes);
  const DenseDynamics dense = to_dense(Dynamics(d));
  const Matrix one = Matrix::Identity(n * K, n * K);
  const Matrix step =
      rule == Rule::exponential ? oracle::exponential(h * dense.A) : Matrix((one - h * dense.A).inverse());
  RowMatrix term = r.output.cwiseProduct(r.initial);
  Vector x = x0;
  for (Index j = 1; j <= J; ++j, term = term.cwiseProduct(r.decay)) {
    x = step * x;
    const Vector seen = S * (dense.N * x), found = term.colwise().sum().transpose();
    // Modes are divided by b_k and multiplied again: relative rounding only.
    EXPECT_LE((seen - found).cwiseAbs().maxCoeff(), 1e-13) << "step " << j;
  }
}

TEST(ModalRecurrence, InitialState) {
  for (const Rule rule : {Rule::exponential, Rule::implicit_euler}) {
    expect_initial_response(signorini_dynamics(3, 5, 0.05), rule);
    expect_initial_response(signorini_dynamics(8, 1, 0.05), rule);
  }
}

TEST(ModalRecurrence, RefusesX0InAModeThatIsNotDriven) {
  // b = e_4 vanishes in mode 3, sin(pi 4 3/6) = 0, so the driven state cannot represent x0 there.
  KroneckerDynamics d = signorini_dynamics(2, 5, 0.05);
  d.b = Vector{{0, 0, 0, 1, 0}};
  EXPECT_THROW(modal_recurrence(d, Rule::exponential, 0.1, RowMatrix::Ones(2, 5)), Error);
  EXPECT_NO_THROW(modal_recurrence(d, Rule::exponential, 0.1, RowMatrix()));
}

TEST(Euler, PrintedMatricesOfThePaper) {
  const Scene scene = make_scene("dlcp-small");
  const auto& d = get<DenseDynamics>(scene.dynamics);
  // The paper assigns them to steps twice as large; these are the steps that match.
  const std::array<Matrix, 3> printed{Matrix{{0.6725, -0.9942, -0.3333, -1.6725},
                                             {-0.6598, 0.3480, -0.6511, -1.3246},
                                             {-0.6569, -0.0226, 0.0058, -1.6696},
                                             {-1.0253, -0.0263, -1.6803, 0.3421}},
                                      Matrix{{0.6782, -0.9884, -0.3334, -1.6783},
                                             {-0.6528, 0.3628, -0.6355, -1.3160},
                                             {-0.6472, -0.0119, 0.0117, -1.6725},
                                             {-1.0506, -0.0526, -1.6939, 0.3509}},
                                      Matrix{{0.6896, -0.9770, -0.3335, -1.6897},
                                             {-0.6385, 0.3925, -0.6045, -1.2993},
                                             {-0.6279, 0.0095, 0.0232, -1.6785},
                                             {-1.1007, -0.1050, -1.7207, 0.3686}}};
  for (std::size_t i = 0; i < 3; ++i) {
    const double h = std::ldexp(1.0, int(i) - 9);
    const Matrix implicit = to_dense(scene.M) + dense_recurrence(d, Rule::implicit_euler, h).w0;
    EXPECT_LE((implicit - printed[i]).cwiseAbs().maxCoeff(), 5e-5 * (1 + 1e-10)) << "h = " << h;  // four digits
  }
}

}  // namespace
}  // namespace bromwich
