// Batches of complementarity problems by structure and size: one problem per row, known solutions with half the
// constraints active.
//
// symbol  meaning
// q       w - M y for y, w >= 0 with y_i w_i = 0, so that y is a solution; q = r + v is split at random
// random  every index of every row is active with probability 1/2, y and w uniform in (0, 1): rows are independent, the
//         worst case for solvers that keep their active set from one row to the next
// smooth  y_i = max(0, z_i), w_i = max(0, -z_i), z_i a sine over the rows with one to eight periods, as in time
// warm    every call starts from the solution, as the last sweeps of an iteration do: it confirms the active set
// cold    every call starts from y = 0, set outside the timing
//
// Traffic: r, v and y read, y written, 32 bytes per constraint. Useful operations per sweep: 15 per constraint for the
// Thomas algorithm and w (7 eliminate, 2 substitute, 6 for w); 2/3 s^3 + 2 s^2 + 2 n s for a dense matrix with s active
// constraints, or 2 n s if the transform of the active set is available (smooth). Divisions: one per constraint and
// sweep if the lanes of the backend eliminate (tridiagonal, dense up to n = 16). Not counted for PSD and unknown M,
// where pivoting or a least-norm solution may follow and a sweep is different.

#include "bench/micro.hpp"

#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>

namespace bromwich::micro {

namespace {

// Residuals are relative to the largest q and of rounding level: a few hundred roundings for these matrices.
constexpr double accepted_residual = 1e-11;

struct Batch {
  std::string name;
  std::function<LcpMatrix(Index n, Random&)> matrix;
  LcpClass lcp_class;
  bool smooth, warm;
};

// Strictly diagonally dominant, off-diagonal entries of both signs.
LcpMatrix tridiagonal_P(Index n, Random& random) {
  return Tridiagonal{1.5 * random.matrix(n, 1), Vector::Constant(n, 4), 1.5 * random.matrix(n, 1)};
}

LcpMatrix tridiagonal_Z(Index n, Random&) {
  return Tridiagonal{Vector::Constant(n, -1), Vector::Constant(n, 2.5), Vector::Constant(n, -1)};
}

// Positive definite symmetric part and an equally large skew part.
LcpMatrix dense_P(Index n, Random& random) {
  const Matrix G = random.matrix(n, n), S = random.matrix(n, n);
  return Matrix(G * G.transpose() / double(n) + (S - S.transpose()) / 2 + 0.2 * Matrix::Identity(n, n));
}

// Diagonally dominant, off-diagonal entries negative.
LcpMatrix dense_Z(Index n, Random& random) {
  Matrix M = -(random.matrix(n, n).array() + 1) / (2.0 * double(n));
  M.diagonal().setConstant(1.2);
  return M;
}

// Symmetric of rank n-1.
LcpMatrix dense_PSD(Index n, Random& random) {
  const Matrix G = random.matrix(n, n - 1);
  return Matrix(G * G.transpose() / double(n));
}

// All entries positive, all minors of order two negative: strictly copositive, so that Lemke's pivoting ends, but
// neither P nor PSD.
LcpMatrix dense_unknown(Index n, Random& random) {
  Matrix M = random.matrix(n, n).array() / 2 + 1.1;
  M.diagonal().setConstant(0.5);
  return M;
}

// y - w, one row per problem.
RowMatrix complementary_pairs(Index rows, Index n, bool smooth, Random& random) {
  RowMatrix z(rows, n);
  if (!smooth) {
    for (double& value : z.reshaped()) value = random.uniform(-1, 1);
    return z;
  }
  for (Index i = 0; i < n; ++i) {
    const double periods = random.uniform(1, 8), phase = random.uniform(0, 2 * std::numbers::pi);
    for (Index j = 0; j < rows; ++j)
      z(j, i) = std::sin(2 * std::numbers::pi * periods * double(j) / double(rows) + phase);
  }
  return z;
}

struct Problems {
  LcpMatrix M;
  std::unique_ptr<Array> r, v, y;
  RowMatrix zero;
  double operations = 0;  ///< mean over the rows, useful, of one sweep

  Problems(const Batch& batch, Index n, Index rows) {
    Random random{std::uint64_t(n)};
    M = batch.matrix(n, random);
    const RowMatrix z = complementary_pairs(rows, n, batch.smooth, random), part = random.matrix(rows, n);
    RowMatrix q(rows, n);
    for (Index j = 0; j < rows; ++j) {
      const Vector y = z.row(j).cwiseMax(0).transpose();
      q.row(j) = (-z.row(j)).cwiseMax(0) - multiply(M, y).transpose();
      operations += of_sweep(double(n), double((y.array() > 0).count()), batch.smooth) / double(rows);
    }
    r = device(q - part);
    v = device(part);
    zero.setZero(rows, n);
    y = device(zero);
  }

 private:
  double of_sweep(double n, double s, bool smooth) const {
    if (std::holds_alternative<Tridiagonal>(M)) return 15 * n;
    return smooth ? 2 * n * s : 2.0 / 3 * s * s * s + 2 * s * s + 2 * n * s;
  }
};

void lcp(benchmark::State& state, const Batch& batch) {
  const Index n = state.range(0), rows = state.range(1);
  Problems p(batch, n, rows);
  const auto plan = backend().lcp(p.M, batch.lcp_class, rows);
  LcpReport report = plan->solve(*p.r, *p.v, *p.y, 0, 0);
  if (report.count.unsolved > 0 || !(plan->residual(*p.r, *p.v, *p.y) <= accepted_residual))
    return state.SkipWithError("a problem stayed unsolved");
  for (auto _ : state) {
    if (!batch.warm) backend().upload(p.zero, *p.y);
    const auto start = std::chrono::steady_clock::now();
    report = plan->solve(*p.r, *p.v, *p.y, 0, 0);
    state.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  const double problems = double(rows), sweeps = double(report.count.newton) / problems, values = problems * double(n);
  state.counters["problems"] = rate(problems);
  state.counters["sweeps"] = sweeps;
  state.counters["fallbacks"] = double(report.count.fallbacks) / problems;
  Work work{.bytes = 32 * values, .footprint = 24 * values};
  const bool by_elimination = is_continuous(batch.lcp_class);
  if (by_elimination && report.count.fallbacks <= rows / 100) {
    work.flops = problems * sweeps * p.operations;
    if (std::holds_alternative<Tridiagonal>(p.M) || n <= 16) work.divisions = values * sweeps;
  }
  count(state, work);
}

benchmark::internal::Benchmark* add(const Batch& batch) {
  const std::string name =
      batch.name + (batch.smooth ? "/rows_are:smooth" : "") + "/start:" + (batch.warm ? "warm" : "cold");
  auto* made = benchmark::RegisterBenchmark(name.c_str(), [batch](benchmark::State& state) { lcp(state, batch); });
  return made->ArgNames({"n", "rows"})->UseManualTime();
}

}  // namespace

void register_lcp() {
  for (const bool warm : {true, false}) {
    for (const Index n : {39, 127, 511, 1023}) {
      add({"lcp_tridiagonal/class:P", tridiagonal_P, LcpClass::P, false, warm})->Args({n, 4096});
      add({"lcp_tridiagonal/class:Z", tridiagonal_Z, LcpClass::Z, false, warm})->Args({n, 4096});
    }
    for (const Index n : {1, 2, 4, 8, 16, 32, 64}) {
      add({"lcp_dense/class:P", dense_P, LcpClass::P, false, warm})->Args({n, 4096});
      add({"lcp_dense/class:Z", dense_Z, LcpClass::Z, false, warm})->Args({n, 4096});
      if (n == 1) continue;  // a positive number is P
      // Pivoting is slow: fewer rows.
      const Index rows = n <= 8 ? 4096 : 256;
      add({"lcp_dense/class:PSD", dense_PSD, LcpClass::PSD, false, warm})->Args({n, rows});
      add({"lcp_dense/class:unknown", dense_unknown, LcpClass::unknown, false, warm})->Args({n, rows});
    }
    for (const Index n : {32, 64}) add({"lcp_dense/class:P", dense_P, LcpClass::P, true, warm})->Args({n, 4096});
  }
}

}  // namespace bromwich::micro
