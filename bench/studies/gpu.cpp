// The CUDA backend on the signorini scene: one sweep of the functional iteration split into its operations, compared
// with the copy bandwidth and the product rate of the same run; whole solves; and time stepping on the CPU of the same
// machine, with the error that each one reaches.

#include "bench/studies/gpu.hpp"
#include "app/commands.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace bromwich::app {

namespace {

/// What the text says of Fig. 4.10 at h = 0.01: the iteration there, implicit Euler on one core of an i7-3770K.
struct PaperTimes {
  double dx, iteration, euler;  ///< seconds
};
constexpr PaperTimes times_of_paper[] = {{0.025, 30, 27.5 * 60}, {1. / 512, 1.4 * 3600, 15 * 3600}};

void add_paper(BenchReport& report) {
  for (const PaperTimes& t : times_of_paper)
    report.rows.push_back(
        {{"part", "paper, Fig. 4.10"}, {"dx", t.dx}, {"iteration_seconds", t.iteration}, {"euler_seconds", t.euler}});
}

/// A column of Table 4.1: signorini with Q points along the contact and J steps.
struct Column {
  double Q;
  Index J;
};

/// Case I: dx = 1/40, h = 1/16 to 1/512; Case II: h = 1/100, dx = 1/16 to 1/512.
std::vector<Column> columns_of_table(double T) {
  std::vector<Column> columns;
  for (Index per_unit = 16; per_unit <= 512; per_unit *= 2) columns.push_back({39, Index(T * double(per_unit))});
  for (Index cells = 16; cells <= 512; cells *= 2) columns.push_back({double(cells - 1), Index(T * 100)});
  return columns;
}

void check_request(const BenchRequest& request) {
  if (request.scene && *request.scene != "signorini")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses signorini");
  for (const auto& [key, value] : request.settings)
    if (key != "Q" && key != "table" && key != "problems")
      throw Error("--set", "found '" + key + "'", "set Q, table = 1, problems = 1, or nothing");
}

std::vector<std::string> sweep_line(double Q, Index J, const Sweep& s, const Json& row) {
  const auto percent = [&](const char* key) { return fmt::format("{:.0f} %", 100 * row[key].get<double>()); };
  return {fmt::format("{}", Q),
          fmt::format("{}", J),
          fmt::format("{}", s.exponentials),
          format_seconds(median(s.whole)),
          s.recorded.empty() ? "-" : format_seconds(median(s.recorded)),
          format_seconds(median(s.lcp)),
          percent("lcp_of_copy"),
          format_seconds(median(s.transform)),
          percent("transform_of_gemm"),
          format_seconds(median(s.scan)),
          s.fft.empty() ? "-" : format_seconds(median(s.fft))};
}

std::vector<std::string> solve_line(double Q, const GpuContestant& c) {
  return {fmt::format("{}", Q),
          fmt::format("{}", c.result.steps),
          c.name,
          to_string(c.result.status),
          fmt::format("{}", c.result.iterations),
          format_seconds(median(c.samples.setup)),
          format_seconds(median(c.samples.solve)),
          c.options.method == Method::contour ? format_seconds(median(c.sweeps)) : "-",
          format_seconds(median(c.samples.total)),
          c.error.max > 0 ? scientific(c.error.max) : "-"};
}

}  // namespace

BenchReport bench_gpu(const BenchRequest& request, Backend& backend) {
  check_request(request);
  const auto cuda = make_cuda_backend(make_cpu_backend(backend.device().threads));
  const auto alone = make_cpu_backend(1);
  const CudaCeilings ceilings = cuda_ceilings();
  BenchReport report;
  report.scene = "signorini";
  report.parameters = {{"device", cuda->device().name},
                       {"copy_bytes_per_second", ceilings.copy_bytes_per_second},
                       {"gemm_flops_per_second", ceilings.gemm_flops_per_second}};
  report.details["seconds"] = "of one sweep or operation, mean of 20 without a wait in between";
  report.details["recorded"] = "the sweep started as one CUDA graph";
  report.details["lcp"] = "warm: every problem starts from its solution; the report of the batch on the host included";
  report.details["lcp_of_copy"] = "32 bytes a value over its time, as part of the copy bandwidth";
  report.details["upload"] = "of one array from pageable memory, and back";
  report.details["solve"] = "whole solves, set-up included; sweeps_seconds is the iteration without its first batch";
  report.details["error_max"] = error_definition;
  std::vector<double> points{39, 127, 255, 511, 1023};
  std::vector<Index> grids{400, 4096, 16384};
  if (request.quick) points = {39}, grids = {400};
  if (request.settings.contains("Q")) points = {request.settings.at("Q")};
  if (request.steps > 0) grids = {request.steps};
  const bool table_alone = request.settings.contains("table");        // the sweeps of Table 4.1 and nothing else
  const bool problems_alone = request.settings.contains("problems");  // batches of problems and nothing else
  if (table_alone || problems_alone) points.clear();
  std::vector<std::vector<std::string>> sweeps{
      {"Q", "J", "K", "sweep", "recorded", "LCP", "of copy", "transform", "of GEMM", "scan", "FFT"}};
  std::vector<std::vector<std::string>> solves{
      {"Q", "J", "contestant", "status", "sweeps", "setup", "solve", "in sweeps", "total", "error"}};
  for (const double Q : points)
    for (const Index J : grids) {
      const Scene scene = make_scene("signorini", {{"Q", Q}});
      const Sweep s = measure_sweep(scene, *cuda, J, request.repeats());
      report.rows.push_back(sweep_row(Q, J, s, ceilings));
      sweeps.push_back(sweep_line(Q, J, s, report.rows.back()));
      for (const GpuContestant& c :
           measure_solves(scene, J, *cuda, *alone, backend, std::min(request.repeats(), 3), request.quick)) {
        report.rows.push_back(solve_row(Q, c));
        solves.push_back(solve_line(Q, c));
      }
    }
  if (table_alone)
    for (const auto& [Q, J] : columns_of_table(make_scene("signorini", {}).T)) {
      const Sweep s = measure_sweep(make_scene("signorini", {{"Q", Q}}), *cuda, J, request.repeats());
      report.rows.push_back(sweep_row(Q, J, s, ceilings));
      sweeps.push_back(sweep_line(Q, J, s, report.rows.back()));
    }
  std::string transforms, small;
  if (!table_alone) {
    if (!problems_alone) transforms = measure_transforms(request.quick, ceilings, report);
    small = measure_small_problems(*cuda, request.repeats(), request.quick, ceilings, report);
  }
  if (!problems_alone) add_paper(report);
  print(fmt::format("{}: copy {:.2f} TB/s, DGEMM {:.1f} Tflop/s\n", cuda->device().name,
                    1e-12 * ceilings.copy_bytes_per_second, 1e-12 * ceilings.gemm_flops_per_second) +
        table(sweeps) + table(solves) + transforms + small);
  return report;
}

}  // namespace bromwich::app
