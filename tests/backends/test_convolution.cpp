// Contract of Backend: causal convolutions by recurrence and by table, against direct summation.

#include "core/kernel/memory_length.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/kernel/weights.hpp"
#include "core/numerics/orthogonal_factor.hpp"
#include "tests/support/backends.hpp"

#include <Eigen/Dense>

namespace bromwich {
namespace {

using reference::Random;

class BackendConvolution : public BackendTest {
 protected:
  RowMatrix apply(Convolution& convolution, const RowMatrix& y, Index outputs) {
    const auto in = device(y), out = backend->array(y.rows(), outputs);
    convolution.apply(*in, *out, 0);
    return host(*out);
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, BackendConvolution, testing::ValuesIn(backend_cases()), backend_case_name);

/// Decays from fast to 1, coefficients of both signs.
ModalRecurrence random_modal(Random& random, Index n, Index K) {
  ModalRecurrence r;
  r.decay = random.matrix(K, n).cwiseAbs();
  r.decay.row(K - 1).setOnes();
  r.output = random.matrix(K, n) / double(K);
  r.start = random.matrix(K, n);
  r.w0 = random.vector(n);
  r.w1 = random.vector(n);
  r.s1 = random.vector(n);
  return r;
}

/// m states that rotate and decay.
DenseRecurrence random_dense(Random& random, Index n, Index m) {
  DenseRecurrence r;
  r.decay = 0.98 * orthogonal_factor(random.matrix(m, m).householderQr().householderQ());
  r.input = random.matrix(m, n);
  r.start = random.matrix(m, n);
  r.output = random.matrix(n, m) / double(m);
  r.w0 = random.matrix(n, n);
  return r;
}

/// |v| <= Σ_d |W_d| max |y|, with |W_d| of the recurrence below `largest`. The order of summation, the powers of the
/// decay (one rounding per lag) and an FFT (log of the length) each cost at most one rounding per row.
double tolerance(Index rows, double largest) { return epsilon * double(rows + 16) * double(rows) * largest / 4; }

const std::vector<Index> row_counts{1, 2, 3, 129, 130, 400, 1000};

TEST_P(BackendConvolution, ModalAgainstDirectSums) {
  for (const Index n : {1, 3, 8, 9, 39})
    for (const Index K : {1, 8, 13})
      for (const Index rows : row_counts) {
        if (rows == 1000 && n != 9) continue;
        Random random(std::uint32_t(100 * n + K));
        const ModalRecurrence r = random_modal(random, n, K);
        const LagTable table = lag_table(r, rows - 1);
        const RowMatrix y = random.matrix(rows, n), exact = reference::convolve(table, y);
        const auto scan = backend->convolution(Recurrence(r), rows), fft = backend->convolution(table, rows);
        EXPECT_LE(distance(apply(*scan, y, n), exact), tolerance(rows, 2)) << "scan " << n << ' ' << K << ' ' << rows;
        EXPECT_LE(distance(apply(*fft, y, n), exact), tolerance(rows, 2)) << "fft " << n << ' ' << K << ' ' << rows;
      }
}

/// The slowest decay of mode l is 0.5^((l/n)^2 40): the first modes have full memory, the last almost none.
ModalRecurrence forgetting_modal(Random& random, Index n, Index K) {
  ModalRecurrence r = random_modal(random, n, K);
  for (Index l = 0; l < n; ++l) r.decay.col(l) *= std::pow(0.5, 40 * double(l * l) / double(n * n));
  return r;
}

/// The recurrence itself, row by row.
RowMatrix by_recurrence(const ModalRecurrence& r, const RowMatrix& y) {
  RowMatrix v = RowMatrix::Zero(y.rows(), y.cols());
  RowMatrix z = r.start * y.row(0).asDiagonal();
  if (r.initial.size() > 0) z += r.initial;
  for (Index j = 1; j < y.rows(); ++j) {
    const Vector& before = j == 1 ? r.s1 : r.w1;
    v.row(j) = r.w0.transpose().cwiseProduct(y.row(j)) + before.transpose().cwiseProduct(y.row(j - 1)) +
               r.output.cwiseProduct(z).colwise().sum();
    z = r.decay.cwiseProduct(z) + RowMatrix::Ones(r.exponentials(), 1) * y.row(j);
  }
  return v;
}

TEST_P(BackendConvolution, ModesThatForget) {
  for (const auto& [n, K, rows] : {std::tuple<Index, Index, Index>{9, 5, 3},
                                   {40, 9, 70},
                                   {70, 48, 500},
                                   {33, 16, 900},
                                   {100, 9, 3300},
                                   {40, 70, 3300}}) {
    Random random{std::uint32_t(n)};
    const ModalRecurrence r = forgetting_modal(random, n, K);
    RowMatrix y = random.matrix(rows, n);
    const auto plan = backend->convolution(Recurrence(r), rows);
    const auto in = device(y), out = backend->array(rows, n);
    plan->apply(*in, *out, 0);
    EXPECT_LE(distance(host(*out), by_recurrence(r, y)), tolerance(rows, 2)) << n << ' ' << rows;
    for (const Index first : {rows / 3, rows - 1}) {
      y.bottomRows(rows - first) *= -0.7;
      backend->upload(y, *in);
      plan->apply(*in, *out, first);
      EXPECT_LE(distance(host(*out), by_recurrence(r, y)), tolerance(rows, 2)) << n << ' ' << rows << ' ' << first;
    }
  }
}

/// Bound on the rounding error of rows of mode l. A term of v_j is a product of a power of E and its factors, at most
/// 2D + 8 roundings if D lags matter, in a sum of at most D + K terms; the same for by_recurrence; plus one rounding
/// for the sum of the lags beyond D.
Vector rounding(const ModalRecurrence& r, Index rows) {
  const auto lags = memory_lengths(r, rows - 1);
  Vector allowed(r.modes());
  for (Index l = 0; l < r.modes(); ++l) {
    const auto C = r.output.col(l).array().abs(), E = r.decay.col(l).array().abs(), G0 = r.start.col(l).array().abs();
    double D = double(lags[std::size_t(l)]), weights = std::abs(r.w0[l]) + std::abs(r.w1[l]) + std::abs(r.s1[l]);
    for (Index k = 0; k < r.exponentials(); ++k) {
      const double powers = E[k] == 1 ? D : (1 - std::pow(E[k], D)) / (1 - E[k]);
      weights += C[k] * (powers * std::max(1.0, G0[k]) + (r.initial.size() > 0 ? std::abs(r.initial(k, l)) : 0));
    }
    allowed[l] = 2 * epsilon * (3 * D + double(r.exponentials()) + 8) * weights;
  }
  return allowed;
}

/// Largest |a - b| over the rows per mode, relative to `allowed`.
double excess(const RowMatrix& a, const RowMatrix& b, const Vector& allowed) {
  return ((a - b).cwiseAbs().colwise().maxCoeff().transpose().array() / allowed.array()).maxCoeff();
}

/// Blocks of eight modes with a memory of all, about 20, 60 and 200 lags in turn.
ModalRecurrence uneven_modal(Random& random, Index n, Index K) {
  ModalRecurrence r = random_modal(random, n, K);
  const double slowest[] = {1, 0.15, 0.53, 0.83};
  for (Index l = 0; l < n; ++l) r.decay.col(l) *= slowest[l / 8 % 4];
  return r;
}

TEST_P(BackendConvolution, NeighboursThatRememberDifferently) {
  for (const auto& [n, K, rows] :
       {std::tuple<Index, Index, Index>{75, 24, 700}, {75, 8, 130}, {75, 48, 18}, {21, 40, 2}, {17, 3, 1100}}) {
    Random random{std::uint32_t(rows)};
    const ModalRecurrence r = uneven_modal(random, n, K);
    const Vector allowed = rounding(r, rows);
    RowMatrix y = random.matrix(rows, n);
    const auto plan = backend->convolution(Recurrence(r), rows);
    const auto in = device(y), out = backend->array(rows, n);
    for (const Index first : {0, 1, 2, 16, 17, 100, 127, 128, 129, 130, 257, 699}) {
      if (first >= rows) continue;
      y.bottomRows(rows - first) = random.matrix(rows - first, n);
      backend->upload(y, *in);
      plan->apply(*in, *out, first);
      EXPECT_LE(excess(host(*out), by_recurrence(r, y), allowed), 1) << n << ' ' << K << ' ' << rows << ' ' << first;
    }
  }
}

// More groups of 32 modes than a device has room for warps, and a last group that is not full.
TEST_P(BackendConvolution, ModesForAllWarps) {
  const Index n = 34005, K = 11;
  for (const Index rows : {2, 17, 70}) {
    Random random{std::uint32_t(rows)};
    ModalRecurrence r = random_modal(random, n, K);
    r.initial = random.matrix(K, n);
    RowMatrix y = random.matrix(rows, n);
    const auto plan = backend->convolution(Recurrence(r), rows);
    const auto in = device(y), out = backend->array(rows, n);
    for (const Index first : {Index(0), rows - 1}) {
      y.bottomRows(rows - first) *= -0.7;
      backend->upload(y, *in);
      plan->apply(*in, *out, first);
      const RowMatrix v = host(*out), exact = by_recurrence(r, y);
      // As `tolerance`, with |W_d| <= 2 and x0 of the size of K rows.
      EXPECT_LE(distance(v, exact), tolerance(rows, 2 + double(K))) << rows << ' ' << first;
    }
  }
}

// A grid that follows a finer one, with sums and differences of two faces. A device keeps few rates for modes that
// forget (core/kernel/shells.hpp): each lag is off by less than 1e-10 of the largest one, as tests/solve/test_faces.cpp
// shows.
TEST_P(BackendConvolution, ModesOfTwoFacesOnACoarseGrid) {
  KroneckerDynamics d{{15, 1 / 16., 0.5}, {24, 1 / 25., 0.02}, Vector::Unit(24, 0), -Vector::Unit(24, 0)};
  d.beside = {{9, 1 / 17., 0.5}};
  d.both_faces = true;
  const Index rows = 257;
  const ModalRecurrence r = coarsen(modal_recurrence(d, Rule::exponential, 2.0 / 512, RowMatrix()));
  const RowMatrix y = Random(9).matrix(rows, r.modes());
  const RowMatrix v = apply(*backend->convolution(Recurrence(r), rows), y, r.modes());
  EXPECT_LE(distance(v, by_recurrence(r, y)), double(rows) * 1e-10 * lag_table(r, rows - 1).W.cwiseAbs().maxCoeff());
}

TEST_P(BackendConvolution, ExponentialsThatGrowOrStartFromTheState) {
  // Fewer rows than exponentials, and more; modes with and without decay.
  for (const Index rows : {2, 30, 90, 300})
    for (const bool starts : {false, true}) {
      const Index n = 20, K = 48;
      Random random{std::uint32_t(rows)};
      ModalRecurrence r = uneven_modal(random, n, K);
      for (Index l = 0; l < n; l += 3) r.decay(l % K, l) = 1.01;
      if (starts) r.initial = random.matrix(K, n);
      const RowMatrix y = random.matrix(rows, n);
      const auto plan = backend->convolution(Recurrence(r), rows);
      EXPECT_LE(excess(apply(*plan, y, n), by_recurrence(r, y), rounding(r, rows)), 1) << rows << ' ' << starts;
    }
}

TEST_P(BackendConvolution, DenseAgainstDirectSums) {
  // With 30 states a step is expensive enough that time is cut into chunks.
  for (const auto& [n, m] : {std::pair<Index, Index>{1, 1}, {3, 5}, {8, 2}, {2, 30}})
    for (const Index rows : row_counts) {
      Random random(std::uint32_t(100 * n + m));
      const DenseRecurrence r = random_dense(random, n, m);
      const LagTable table = lag_table(r, rows - 1);
      const RowMatrix y = random.matrix(rows, n), exact = reference::convolve(table, y);
      const auto scan = backend->convolution(Recurrence(r), rows), fft = backend->convolution(table, rows);
      const double largest = 2 * double(n);  // rows of |W_d|
      EXPECT_LE(distance(apply(*scan, y, n), exact), tolerance(rows, largest))
          << "scan " << n << ' ' << m << ' ' << rows;
      EXPECT_LE(distance(apply(*fft, y, n), exact), tolerance(rows, largest)) << "fft " << n << ' ' << m << ' ' << rows;
    }
}

/// One plan of each kind for the common properties: name, plan, memory in rows.
struct Kind {
  const char* name;
  std::unique_ptr<Convolution> plan;
};

std::vector<Kind> all_kinds(Backend& backend, Index n, Index rows) {
  Random random(8);
  const ModalRecurrence modal = random_modal(random, n, 9);
  const DenseRecurrence dense = random_dense(random, n, 30);
  std::vector<Kind> kinds;
  kinds.push_back({"modal scan", backend.convolution(Recurrence(modal), rows)});
  kinds.push_back({"modal fft", backend.convolution(lag_table(modal, rows - 1), rows)});
  kinds.push_back({"dense scan", backend.convolution(Recurrence(dense), rows)});
  kinds.push_back({"dense fft", backend.convolution(lag_table(dense, rows - 1), rows)});
  return kinds;
}

TEST_P(BackendConvolution, LinearCausalAndZeroAtTheStart) {
  const Index n = 5, rows = 517, change = 300;
  Random random(9);
  const RowMatrix a = random.matrix(rows, n), b = random.matrix(rows, n);
  RowMatrix late = a;
  late.bottomRows(rows - change) = b.bottomRows(rows - change);
  for (const auto& [name, plan] : all_kinds(*backend, n, rows)) {
    const RowMatrix va = apply(*plan, a, n), vb = apply(*plan, b, n), both = apply(*plan, 2 * a - 3 * b, n);
    EXPECT_LE(distance(both, 2 * va - 3 * vb), tolerance(rows, 5 * 2 * double(n))) << name;
    EXPECT_EQ(va.row(0).cwiseAbs().maxCoeff(), 0) << name;
    const RowMatrix v = apply(*plan, late, n);
    EXPECT_LE(distance(v.topRows(change), va.topRows(change)), tolerance(rows, 2 * double(n))) << name;
    EXPECT_GT(distance(v.row(change), va.row(change)), 1e-3) << name << ": W_0 acts at once";
    EXPECT_GT(plan->bytes(), 0u) << name;
  }
}

TEST_P(BackendConvolution, RestartGivesTheSameRows) {
  const Index n = 9, rows = 700;
  for (const auto& [name, plan] : all_kinds(*backend, n, rows)) {
    Random random(10);
    RowMatrix y = random.matrix(rows, n);
    const auto in = device(y), out = backend->array(rows, n);
    plan->apply(*in, *out, 0);
    for (const Index first : {1, 2, 128, 129, 130, 257, 300, 699, 700}) {
      y.bottomRows(rows - first) = random.matrix(rows - first, n);
      backend->upload(y, *in);
      const RowMatrix before = host(*out);
      plan->apply(*in, *out, first);
      const RowMatrix v = host(*out);
      const double allowed = tolerance(rows, 2 * double(n));
      EXPECT_LE(distance(v.topRows(first), before.topRows(first)), allowed) << name << ", first = " << first;
      for (const Kind& other : all_kinds(*backend, n, rows)) {
        if (std::string(other.name) != name) continue;
        EXPECT_LE(distance(v, apply(*other.plan, y, n)), allowed) << name << ", first = " << first;
      }
    }
  }
}

TEST_P(BackendConvolution, RowsBeforeFirstKeepTheirValues) {
  const Index n = 3, rows = 300, first = 200;
  for (const auto& [name, plan] : all_kinds(*backend, n, rows)) {
    RowMatrix changed = Random(11).matrix(rows, n);
    const auto y = device(changed), v = backend->array(rows, n), again = backend->array(rows, n);
    plan->apply(*y, *v, 0);
    const RowMatrix before = host(*v);
    changed.bottomRows(rows - first) *= -2;
    backend->upload(changed, *y);
    plan->apply(*y, *v, first);
    plan->apply(*y, *again, 0);
    EXPECT_LE(distance(host(*v).topRows(first), before.topRows(first)), tolerance(rows, 2 * double(n))) << name;
    EXPECT_LE(distance(host(*v).bottomRows(rows - first), host(*again).bottomRows(rows - first)),
              tolerance(rows, 4 * double(n)))
        << name;
  }
}

TEST_P(BackendConvolution, TablesThatStartFromZeroOrGrow) {
  // An oscillator observed by its position has K(0) = 0. An unstable one grows, and early rows must stay accurate.
  const Index rows = 600;
  for (const bool grows : {false, true}) {
    LagTable table{1, 1, true, RowMatrix(rows, 1), RowMatrix(rows, 1)};
    for (Index d = 0; d < rows; ++d)
      table.W(d, 0) = table.S(d, 0) = grows ? std::exp(0.04 * double(d)) : std::sin(0.02 * double(d) + 1e-4);
    table.S(0, 0) = 0;
    const RowMatrix y = Random(13).matrix(rows, 1), exact = reference::convolve(table, y);
    const auto plan = backend->convolution(table, rows);
    const RowMatrix v = apply(*plan, y, 1);
    double sum = 0;
    for (Index j = 0; j < rows; ++j) {
      sum += std::abs(table.W(j, 0));
      // One rounding per row of the terms of its sum; the oscillator is also bounded by rows times its largest weights.
      const double allowed = epsilon * double(rows + 16) * (grows ? sum : double(rows));
      EXPECT_LE(std::abs(v(j, 0) - exact(j, 0)), allowed) << (grows ? "growing" : "from zero") << ", row " << j;
    }
  }
}

TEST_P(BackendConvolution, InitialStateOfAModalRecurrence) {
  for (const auto& [n, K, rows] : {std::tuple<Index, Index, Index>{1, 1, 2}, {9, 13, 400}}) {
    Random random(12);
    ModalRecurrence r = random_modal(random, n, K);
    const RowMatrix y = random.matrix(rows, n);
    RowMatrix exact = reference::convolve(lag_table(r, rows - 1), y);
    r.initial = random.matrix(K, n);
    // z_0 gains `initial`: v_j gains Σ_k C_k E_k^{j-1} initial_k.
    RowMatrix part = r.output.cwiseProduct(r.initial);
    for (Index j = 1; j < rows; ++j, part = part.cwiseProduct(r.decay)) exact.row(j) += part.colwise().sum();
    const auto plan = backend->convolution(Recurrence(r), rows);
    EXPECT_LE(distance(apply(*plan, y, n), exact), tolerance(rows, 2)) << n;
    EXPECT_LE(distance(apply(*plan, y, n), exact), tolerance(rows, 2)) << "a second time, " << n;
  }
}

/// v_a,j = Σ_b W_ab y_b,j + w1_a y_2,j-1 + Σ_k C_a z_{j-1}, z_j = E z_{j-1} + Σ_b G_b y_b,j, term by term.
RowMatrix step_in_stages(const StageRecurrence& r, const RowMatrix& y) {
  RowMatrix v = RowMatrix::Zero(y.rows(), y.cols());
  for (Index l = 0; l < r.modes(); ++l) {
    Vector z = Vector::Zero(r.exponentials());
    for (Index j = 1; 2 * j < y.rows(); ++j) {
      const double in[2] = {y(2 * j - 1, l), y(2 * j, l)}, before = j > 1 ? y(2 * j - 2, l) : 0;
      for (int a = 0; a < 2; ++a)
        v(2 * j - 1 + a, l) =
            r.w0[a][0][l] * in[0] + r.w0[a][1][l] * in[1] + r.w1[a][l] * before + r.output[a].col(l).dot(z);
      z = r.decay.col(l).cwiseProduct(z) + r.input[0].col(l) * in[0] + r.input[1].col(l) * in[1];
    }
  }
  return v;
}

/// Decays of both signs, as those of Radau IIA are.
TEST_P(BackendConvolution, TakesTwoStagesInEachStep) {
  for (const auto& [n, K] : {std::pair<Index, Index>{1, 7}, {9, 7}, {39, 7}, {39, 58}, {5, 120}})
    for (const Index rows : {1, 3, 129, 1001}) {
      Random random(std::uint32_t(n + rows));
      StageRecurrence r;
      r.decay = 0.95 * random.matrix(K, n);
      for (int a = 0; a < 2; ++a) {
        r.input[a] = random.matrix(K, n) / double(K);
        r.output[a] = random.matrix(K, n);
        r.w1[a] = random.vector(n);
        for (int b = 0; b < 2; ++b) r.w0[a][b] = random.vector(n);
      }
      RowMatrix y = random.matrix(rows, n);
      y.row(0).setZero();
      const auto stages = backend->stage_convolution(r, rows);
      const RowMatrix exact = step_in_stages(r, y);
      EXPECT_LE(distance(apply(*stages, y, n), exact), tolerance(rows, 4)) << n << ' ' << rows << ' ' << K;
      EXPECT_LE(distance(apply(*stages, y, n), exact), tolerance(rows, 4)) << "a second time";
    }
}

TEST_P(BackendConvolution, SplitsAndJoinsStages) {
  for (const Index n : {1, 2, 9})
    for (const Index J : {1, 2, 700}) {
      Random random(std::uint32_t(n + J));
      const RowMatrix all = random.matrix(2 * J + 1, n);
      const auto stages = device(all), first = backend->array(J + 1, n), second = backend->array(J + 1, n),
                 joined = backend->array(2 * J + 1, n);
      backend->take_stages(*stages, *first, *second);
      const RowMatrix odd = host(*first), even = host(*second);
      EXPECT_EQ(odd.row(0), RowMatrix::Zero(1, n));
      for (Index j = 1; j <= J; ++j) EXPECT_EQ(odd.row(j), all.row(2 * j - 1)) << j;
      for (Index j = 0; j <= J; ++j) EXPECT_EQ(even.row(j), all.row(2 * j)) << j;
      backend->put_stages(*first, *second, *joined);
      EXPECT_EQ(host(*joined), all);
    }
}

}  // namespace
}  // namespace bromwich
