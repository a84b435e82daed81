// The CUDA backend on the signorini scene: one sweep of the functional iteration split into its operations, against the
// copy bandwidth and the product rate measured in the same run; whole solves; and the step-by-step methods of the same
// machine's processor, at the error that each reaches.

#include "app/bench/study.hpp"
#include "app/commands.hpp"
#include "app/text.hpp"
#include "core/compression.hpp"
#include "core/error.hpp"
#include "core/kernel.hpp"
#include "core/timer.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/ceilings.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr int runs = 20;  ///< of an operation between two looks at the clock

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

Json spread(const std::vector<double>& seconds) {
  return {{"median", median(seconds)}, {"min", minimum(seconds)}, {"max", maximum(seconds)}};
}

/// y >= 0 that vanishes half of the time, smooth in both directions, and q = w - M y with w = 0 where y > 0.
struct Known {
  RowMatrix y, q;
};

Known known_solution(const Scene& scene, Index rows) {
  const Index n = scene.constraints();
  Known known{RowMatrix(rows, n), RowMatrix(rows, n)};
  for (Index j = 0; j < rows; ++j) {
    Vector z(n);
    for (Index i = 0; i < n; ++i) z[i] = std::sin(0.01 * double(j) + 7 * double(i) / double(n));
    known.y.row(j) = z.cwiseMax(0).transpose();
    known.q.row(j) = ((-z).cwiseMax(0) - multiply(scene.M, z.cwiseMax(0))).transpose();
  }
  return known;
}

/// One sweep and its operations.
struct Sweep {
  std::vector<double> whole, lcp, transform, scan, fft;
  Index exponentials = 0;
};

Sweep measure_sweep(const Scene& scene, Backend& backend, Index J, int repeats) {
  const auto& d = std::get<KroneckerDynamics>(scene.dynamics);
  const Index n = scene.constraints(), rows = J + 1;
  const double h = scene.T / double(J);
  const ExponentialSum sum = compress_line_kernel(d, h, scene.T);
  const auto scan = backend.convolution(Recurrence(compressed_recurrence(backend, d, sum, h)), rows);
  const auto fft = backend.convolution(contour_lag_table(backend, d, *contour_parameters(0), h, J), rows);
  const auto sine = backend.sine_transform(n, rows);
  const auto lcp = backend.lcp(scene.M, scene.lcp_class, rows);
  const Known known = known_solution(scene, rows);
  const auto r = backend.array(rows, n), y = backend.array(rows, n), zero = backend.array(rows, n),
             modes = backend.array(rows, n), v = backend.array(rows, n);
  backend.upload(known.q, *r);
  backend.upload(known.y, *y);
  Sweep sweep;
  sweep.exponentials = sum.rates.size();
  sweep.transform = timed(backend, repeats, [&] { sine->apply(*y, nullptr, *modes, 0); });
  sweep.scan = timed(backend, repeats, [&] { scan->apply(*modes, *v, 0); });
  sweep.fft = timed(backend, repeats, [&] { fft->apply(*modes, *v, 0); });
  sweep.lcp = timed(backend, repeats, [&] { lcp->solve(*r, *zero, *y, 0, 0); });
  sweep.whole = timed(backend, repeats, [&] {
    sine->apply(*y, nullptr, *modes, 0);
    scan->apply(*modes, *v, 0);
    sine->apply(*v, nullptr, *modes, 0);
    lcp->solve(*r, *zero, *y, 0, 0);  // the same problems every time: y stays
  });
  return sweep;
}

Json row(double Q, Index J, const Sweep& s, const CudaCeilings& ceilings) {
  const double values = Q * double(J + 1), bytes = 32 * values, flops = 2 * values * Q;
  return {{"part", "sweep"},
          {"Q", Q},
          {"steps", J},
          {"exponentials", s.exponentials},
          {"seconds", spread(s.whole)},
          {"lcp", spread(s.lcp)},
          {"transform", spread(s.transform)},
          {"scan", spread(s.scan)},
          {"fft", spread(s.fft)},
          {"lcp_of_copy", bytes / median(s.lcp) / ceilings.copy_bytes_per_second},
          {"transform_of_gemm", flops / median(s.transform) / ceilings.gemm_flops_per_second}};
}

struct Solver {
  std::string name;
  Backend* backend;
  Options options;
};

/// Whole solves, interleaved.
void measure_solves(const Scene& scene, double Q, std::vector<Solver> solvers, int repeats, BenchReport& report,
                    std::vector<std::vector<std::string>>& lines) {
  std::vector<Samples> samples(solvers.size());
  std::vector<Result> results;
  for (const Solver& s : solvers) results.push_back(solve(scene, *s.backend, s.options));
  for (int round = 0; round < repeats; ++round)
    for (std::size_t i = 0; i < solvers.size(); ++i) {
      const Seconds seconds = solve(scene, *solvers[i].backend, solvers[i].options).seconds;
      samples[i].add(seconds.total, seconds.setup, seconds.solve);
    }
  for (std::size_t i = 0; i < solvers.size(); ++i) {
    const Result& r = results[i];
    report.rows.push_back({{"part", "solve"},
                           {"contestant", solvers[i].name},
                           {"Q", Q},
                           {"steps", r.steps},
                           {"status", to_string(r.status)},
                           {"iterations", r.iterations},
                           {"iteration_tolerance", solvers[i].options.iteration_tolerance},
                           {"seconds", to_json(samples[i])},
                           {"residual", r.residual},
                           {"difference_from_march", (r.y - results.back().y).cwiseAbs().maxCoeff()},
                           {"bytes", r.bytes}});
    lines.push_back({fmt::format("{}", Q), fmt::format("{}", r.steps), solvers[i].name, to_string(r.status),
                     fmt::format("{}", r.iterations), format_seconds(median(samples[i].setup)),
                     format_seconds(median(samples[i].solve)), format_seconds(median(samples[i].total))});
  }
}

std::vector<Solver> solvers(const Scene& scene, Index J, Backend& cuda, Backend& one, Backend& all) {
  const auto& d = std::get<KroneckerDynamics>(scene.dynamics);
  Options contour;
  contour.method = Method::contour;
  contour.steps = J;
  Options paper = contour;
  paper.iteration_tolerance = std::min(scene.T / double(J), d.along.spacing * d.along.spacing) / 50;
  Options march = contour;
  march.method = Method::march;
  return {{"contour, cuda", &cuda, contour},
          {"contour to the paper's tolerance, cuda", &cuda, paper},
          {"contour to the paper's tolerance, cpu", &all, paper},
          {"march, cpu, all cores", &all, march},
          {"march, cpu, one core", &one, march}};
}

}  // namespace

BenchReport bench_gpu(const BenchRequest& request, Backend& backend) {
  if (request.scene && *request.scene != "signorini")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses signorini");
  for (const auto& [key, value] : request.settings)
    if (key != "Q") throw Error("--set", "found '" + key + "'", "set Q, or nothing");
  const auto cuda = make_cuda_backend(make_cpu_backend(backend.device().threads));
  const auto alone = make_cpu_backend(1);
  const CudaCeilings ceilings = cuda_ceilings();
  BenchReport report;
  report.scene = "signorini";
  report.parameters = {{"device", cuda->device().name},
                       {"copy_bytes_per_second", ceilings.copy_bytes_per_second},
                       {"gemm_flops_per_second", ceilings.gemm_flops_per_second}};
  report.details["seconds"] = fmt::format("of one sweep or operation, mean of {} without a wait in between", runs);
  report.details["lcp"] = "warm: every problem starts from its solution; the report of the batch on the host included";
  report.details["lcp_of_copy"] = "32 bytes a value over its time, as part of the copy bandwidth";
  report.details["solve"] = "whole solves, set-up included; difference_from_march is that of y at all times";
  std::vector<double> points{39, 127, 255, 511, 1023};
  std::vector<Index> grids{400, 4096, 16384};
  if (request.quick) points = {39}, grids = {400};
  if (request.settings.contains("Q")) points = {request.settings.at("Q")};
  if (request.steps > 0) grids = {request.steps};
  std::vector<std::vector<std::string>> sweeps{
      {"Q", "J", "K", "sweep", "LCP", "of copy", "transform", "of GEMM", "scan", "FFT"}};
  std::vector<std::vector<std::string>> solves{{"Q", "J", "contestant", "status", "sweeps", "setup", "solve", "total"}};
  for (const double Q : points)
    for (const Index J : grids) {
      const Scene scene = make_scene("signorini", {{"Q", Q}});
      const Sweep s = measure_sweep(scene, *cuda, J, request.repeats());
      report.rows.push_back(row(Q, J, s, ceilings));
      const Json& last = report.rows.back();
      sweeps.push_back({fmt::format("{}", Q), fmt::format("{}", J), fmt::format("{}", s.exponentials),
                        format_seconds(median(s.whole)), format_seconds(median(s.lcp)),
                        fmt::format("{:.0f} %", 100 * last["lcp_of_copy"].get<double>()),
                        format_seconds(median(s.transform)),
                        fmt::format("{:.0f} %", 100 * last["transform_of_gemm"].get<double>()),
                        format_seconds(median(s.scan)), format_seconds(median(s.fft))});
      if (J <= 4096 && Q <= 511)
        measure_solves(scene, Q, solvers(scene, J, *cuda, *alone, backend), request.repeats(), report, solves);
    }
  print(fmt::format("{}: copy {:.2f} TB/s, DGEMM {:.1f} Tflop/s\n", cuda->device().name,
                    1e-12 * ceilings.copy_bytes_per_second, 1e-12 * ceilings.gemm_flops_per_second) +
        table(sweeps) + table(solves));
  return report;
}

}  // namespace bromwich::app
