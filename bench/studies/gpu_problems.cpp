// Batches of dense complementarity problems with one matrix, by size, beside the copy bandwidth of the same run.
//
// matrix      dominant: n + 1 on the diagonal, -1 beside it, with smooth solutions, so that neighbours have active sets
//             in common; random: positive definite, with an equally large skew part, every index active with
//             probability 1/2; semidefinite: random, symmetric, of rank n - 1, the same solutions' q
// start       warm: from the solution, which confirms its active set; cold: from zero

#include "app/text.hpp"
#include "bench/studies/gpu.hpp"
#include "core/base/timer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <random>
#include <string>

namespace bromwich::app {

namespace {

constexpr Index most_drawn = 1 << 13;  ///< problems, which repeat

struct Draw {
  std::mt19937_64 generator;
  std::uniform_real_distribution<double> uniform{-1, 1};
  RowMatrix matrix(Index rows, Index cols) {
    return RowMatrix::NullaryExpr(rows, cols, [this] { return uniform(generator); });
  }
};

struct Batch {
  std::string matrix;
  LcpClass lcp_class;
  Matrix M;
  Known known;
};

Batch batch_of(const std::string& matrix, Index n, Index rows) {
  Draw draw{std::mt19937_64(std::uint64_t(n))};
  Batch batch{matrix, LcpClass::P, Matrix::Constant(n, n, -1), {}};
  batch.M.diagonal().setConstant(double(n) + 1);
  if (matrix == "dominant") {
    batch.known = known_solution(LcpMatrix(batch.M), std::min(rows, most_drawn));
    return batch;
  }
  const Matrix G = draw.matrix(n, matrix == "random" ? n : n - 1), S = draw.matrix(n, n);
  batch.M = G * G.transpose() / double(n);
  if (matrix == "random")
    batch.M += (S - S.transpose()) / 2 + 0.2 * Matrix::Identity(n, n);
  else
    batch.lcp_class = LcpClass::PSD;
  const RowMatrix z = draw.matrix(std::min(rows, most_drawn), n);
  batch.known.y = z.cwiseMax(0);
  batch.known.q = (-z).cwiseMax(0) - batch.known.y * batch.M.transpose();
  return batch;
}

RowMatrix repeated(const RowMatrix& part, Index rows) {
  RowMatrix all(rows, part.cols());
  for (Index j = 0; j < rows; ++j) all.row(j) = part.row(j % part.rows());
  return all;
}

Index rows_of(const std::string& matrix, Index n, bool quick) {
  if (quick) return n <= 64 ? 4096 : 64;
  if (matrix == "semidefinite") return 4096;
  return n <= 8 ? 1 << 22 : n <= 16 ? 1 << 21 : n <= 64 ? 1 << 18 : n <= 256 ? 1 << 13 : 264;
}

Json row_of(const Batch& batch, Index n, Index rows, bool warm, const std::vector<double>& seconds,
            const LcpReport& report, const CudaCeilings& ceilings) {
  const double rate = double(rows) / median(seconds), bytes = 32 * double(n) * rate;
  return {{"part", "small problems"},
          {"n", n},
          {"rows", rows},
          {"matrix", batch.matrix},
          {"start", warm ? "warm" : "cold"},
          {"seconds", spread(seconds)},
          {"problems_per_second", rate},
          {"of_copy", bytes / ceilings.copy_bytes_per_second},
          {"active_sets", double(report.count.newton) / double(rows)},
          {"on_the_host", report.count.fallbacks},
          {"unsolved", report.count.unsolved}};
}

}  // namespace

std::string measure_small_problems(Backend& backend, int repeats, bool quick, const CudaCeilings& ceilings,
                                   BenchReport& report) {
  std::vector<std::vector<std::string>> lines{{"n", "matrix", "start", "problems", "a batch", "problems/s", "of copy"}};
  for (const char* matrix : {"dominant", "random", "semidefinite"})
    for (const Index n : {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024}) {
      const bool semidefinite = matrix == std::string("semidefinite");
      const Index largest = quick ? 64 : matrix == std::string("dominant") ? 1024 : 256;
      if (n > largest || (semidefinite && n == 1)) continue;
      const Index rows = rows_of(matrix, n, quick);
      const Batch batch = batch_of(matrix, n, rows);
      const auto lcp = backend.lcp(LcpMatrix(batch.M), batch.lcp_class, rows);
      const auto r = backend.array(rows, n), y = backend.array(rows, n), zero = backend.array(rows, n),
                 start = backend.array(rows, n);
      backend.upload(repeated(batch.known.q, rows), *r);
      if (!semidefinite) backend.upload(repeated(batch.known.y, rows), *start);
      for (const bool warm : {true, false}) {
        if (warm && semidefinite) continue;  // what is known is no solution of least norm
        LcpReport last;
        std::vector<double> seconds;
        for (int round = -1; round < repeats; ++round) {
          backend.add(warm ? *start : *zero, 0, *zero, *y);
          backend.wait();
          Timer timer;
          last = lcp->solve(*r, *zero, *y, 0, 0);
          if (round >= 0) seconds.push_back(timer.lap());
        }
        report.rows.push_back(row_of(batch, n, rows, warm, seconds, last, ceilings));
        const Json& row = report.rows.back();
        lines.push_back({fmt::format("{}", n), matrix, warm ? "warm" : "cold", fmt::format("{}", rows),
                         format_seconds(median(seconds)), fmt::format("{:.2e}", double(row["problems_per_second"])),
                         fmt::format("{:.0f} %", 100 * double(row["of_copy"]))});
      }
    }
  return "batches of dense problems with one matrix\n" + table(lines);
}

}  // namespace bromwich::app
