// One sweep of the functional iteration on signorini split into its operations, and the operations for other scenes and
// sizes, compared with the copy bandwidth and the product rate of the same run.

#include "app/text.hpp"
#include "bench/studies/gpu.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/kernel.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr int runs = 20;  ///< of an operation between two readings of the clock
constexpr Index most_fft_values = 2200000;

/// Seconds of one run, several times.
template <class Run>
std::vector<double> timed(Backend& backend, int repeats, Run run) {
  std::vector<double> seconds;
  for (int round = -1; round < repeats; ++round) {
    backend.wait();
    Timer timer;
    for (int i = 0; i < runs; ++i) run();
    backend.wait();
    if (round >= 0) seconds.push_back(timer.lap() / runs);
  }
  return seconds;
}

std::string percent(double part) { return fmt::format("{:.0f} %", 100 * part); }

}  // namespace

Known known_solution(const LcpMatrix& M, Index rows) {
  const Index n = size(M);
  Known known{RowMatrix(rows, n), RowMatrix(rows, n)};
  for (Index j = 0; j < rows; ++j) {
    Vector z(n);
    for (Index i = 0; i < n; ++i) z[i] = std::sin(0.01 * double(j) + 7 * double(i) / double(n));
    known.y.row(j) = z.cwiseMax(0).transpose();
    known.q.row(j) = ((-z).cwiseMax(0) - multiply(M, z.cwiseMax(0))).transpose();
  }
  return known;
}

Sweep measure_sweep(const Scene& scene, Backend& backend, Index J, int repeats) {
  const auto& d = get<KroneckerDynamics>(scene.dynamics);
  const Index n = scene.constraints(), rows = J + 1;
  const double h = scene.T / double(J);
  const ExponentialSum sum = compress_line_kernel(d, h, scene.T);
  const auto scan = backend.convolution(Recurrence(compressed_recurrence(backend, d, sum, h)), rows);
  std::unique_ptr<Convolution> fft;  // if its table does not take longer than everything else
  if (rows * n <= most_fft_values)
    fft = backend.convolution(contour_lag_table(backend, d, *contour_parameters(0), h, J), rows);
  const auto sine = backend.sine_transform(n, rows);
  const auto lcp = backend.lcp(scene.M, scene.lcp_class, rows);
  Known known = known_solution(scene.M, rows);
  const auto r = backend.array(rows, n), y = backend.array(rows, n), zero = backend.array(rows, n),
             modes = backend.array(rows, n), v = backend.array(rows, n);
  Sweep sweep;
  sweep.exponentials = sum.rates.size();
  sweep.upload = timed(backend, repeats, [&] { backend.upload(known.q, *r); });
  backend.upload(known.y, *y);
  sweep.download = timed(backend, repeats, [&] { backend.download(*y, known.y); });
  // The same problems every time: y does not change.
  const auto operations = [&] {
    sine->apply(*y, nullptr, *modes, 0);
    scan->apply(*modes, *v, 0);
    sine->apply(*v, nullptr, *modes, 0);
    lcp->submit(*r, *zero, *y, 0, 0);
  };
  const auto finish = [&] { lcp->finish(*r, *zero, *y, 0, 0); };
  sweep.transform = timed(backend, repeats, [&] { sine->apply(*y, nullptr, *modes, 0); });
  sweep.scan = timed(backend, repeats, [&] { scan->apply(*modes, *v, 0); });
  if (fft) sweep.fft = timed(backend, repeats, [&] { fft->apply(*modes, *v, 0); });
  sweep.lcp = timed(backend, repeats, [&] { lcp->solve(*r, *zero, *y, 0, 0); });
  sweep.whole = timed(backend, repeats, [&] { operations(), finish(); });
  if (const auto program = backend.record(rows * n, operations))
    sweep.recorded = timed(backend, repeats, [&] { program(), finish(); });
  return sweep;
}

Json sweep_row(double Q, Index J, const Sweep& s, const CudaCeilings& ceilings) {
  const double values = Q * double(J + 1), bytes = 32 * values, flops = 2 * values * Q;
  const double parts = median(s.lcp) + 2 * median(s.transform) + median(s.scan);
  return {{"part", "sweep"},
          {"Q", Q},
          {"steps", J},
          {"exponentials", s.exponentials},
          {"seconds", spread(s.whole)},
          {"recorded", s.recorded.empty() ? Json(nullptr) : spread(s.recorded)},
          {"lcp", spread(s.lcp)},
          {"transform", spread(s.transform)},
          {"scan", spread(s.scan)},
          {"fft", s.fft.empty() ? Json(nullptr) : spread(s.fft)},
          {"other", median(s.whole) - parts},
          {"upload", spread(s.upload)},
          {"download", spread(s.download)},
          {"lcp_bytes_per_second", bytes / median(s.lcp)},
          {"lcp_of_copy", bytes / median(s.lcp) / ceilings.copy_bytes_per_second},
          {"transform_flops_per_second", flops / median(s.transform)},
          {"transform_of_gemm", flops / median(s.transform) / ceilings.gemm_flops_per_second},
          {"scan_flops_per_second", 6 * values * double(s.exponentials) / median(s.scan)}};
}

std::string measure_transforms(bool quick, const CudaCeilings& ceilings, BenchReport& report) {
  const Index rows = quick ? 257 : 4097;
  std::vector<std::vector<std::string>> lines{{"n", "product", "of DGEMM", "cuFFT"}};
  for (const Index n : {255, 511, 767, 1023, 1279, 1535, 2047, 4095}) {
    if (quick && n > 511) break;
    const CudaTransformSeconds seconds = cuda_transform_seconds(n, rows);
    const double flops = 2 * double(n) * double(n) * double(rows);
    report.rows.push_back({{"part", "transform"},
                           {"n", n},
                           {"rows", rows},
                           {"product", seconds.product},
                           {"fft", seconds.fft},
                           {"product_of_gemm", flops / seconds.product / ceilings.gemm_flops_per_second}});
    lines.push_back({fmt::format("{}", n), format_seconds(seconds.product),
                     percent(flops / seconds.product / ceilings.gemm_flops_per_second), format_seconds(seconds.fft)});
  }
  return fmt::format("sine transforms of {} rows\n", rows) + table(lines);
}

}  // namespace bromwich::app
