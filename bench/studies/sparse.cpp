// Heat on a square, G x G points, with contact at ten of them: a sparse A with 1e5 states and ten constraints.
//
//     x' = Δ_h x + B y + F phi(t),   0 <= y  ⊥  x(p_i) - psi + P y >= 0,   x(0) = sin(pi s) sin(pi r),   psi = -0.1.
//
// y_i is a point source at p_i that keeps the temperature from falling below the obstacle while F phi, the same in
// every cell, cools the plate. The time is that of the whole solve; a small grid is also solved with A as a dense
// matrix, by e^{hA} instead of contours, and the two must agree.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/heat_on_a_square.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

namespace bromwich::app {

namespace {

constexpr Index contacts = 10;
constexpr double obstacle = -0.1, compliance = 0.05, end = 0.5;
constexpr Index small_grid = 24;  // above the size up to which sparse scenes are solved as dense ones

SparseDynamics plate(Index G) {
  std::vector<Index> points;
  for (Index i = 0; i < contacts; ++i) points.push_back((G / 2) * G + (i + 1) * G / (contacts + 1));
  return heat_on_a_square(G, points);
}

Scene cooled_plate(Index G) {
  Scene scene;
  scene.name = "cooled-plate";
  scene.dynamics = plate(G);
  scene.M = Tridiagonal{Vector::Zero(contacts), Vector::Constant(contacts, compliance), Vector::Zero(contacts)};
  scene.lcp_class = LcpClass::P;
  scene.f_entry = SourceEntry::through_F;
  scene.F = Matrix::Ones(G * G, 1).sparseView();
  scene.f = [](double t, Eigen::Ref<Vector> phi) { phi[0] = -4 - 4 * std::sin(20 * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g.setConstant(-obstacle); };
  scene.x0.resize(G * G);
  for (Index i = 0; i < G; ++i)
    for (Index j = 0; j < G; ++j)
      scene.x0[i * G + j] = std::sin(std::numbers::pi * double(i + 1) / double(G + 1)) *
                            std::sin(std::numbers::pi * double(j + 1) / double(G + 1));
  scene.T = end;
  return scene;
}

struct SparseRun {
  Result result;
  Samples samples;
};

SparseRun measure(const Scene& scene, Backend& backend, Method method, Index steps, int repeats) {
  Options options;
  options.method = method;
  options.steps = steps;
  SparseRun run;
  for (int round = 0; round < repeats; ++round) {
    run.result = solve(scene, backend, options);
    run.samples.add(run.result.seconds.total, run.result.seconds.setup, run.result.seconds.solve);
  }
  return run;
}

Json row(const char* contestant, Index G, Index nonzeros, const SparseRun& run, double difference) {
  const Result& r = run.result;
  return {{"contestant", contestant},
          {"parameters", {{"G", G}}},
          {"states", G * G},
          {"constraints", contacts},
          {"nonzeros", nonzeros},
          {"steps", r.steps},
          {"method", to_string(r.method)},
          {"kernel", r.kernel},
          {"kernel_error", r.kernel_error},
          {"status", to_string(r.status)},
          {"residual", r.residual},
          {"contact_share", r.y.size() > 0 ? double((r.y.array() > 0).count()) / double(r.y.size()) : 0.0},
          {"difference_max", difference},
          {"seconds", to_json(run.samples)},
          {"bytes", r.bytes}};
}

std::vector<std::string> cells(const char* contestant, Index G, const SparseRun& run, double difference) {
  const Result& r = run.result;
  return {fmt::format("{}", G * G),
          contestant,
          to_string(r.status),
          format_seconds(median(run.samples.setup)),
          format_seconds(median(run.samples.solve)),
          scientific(r.kernel_error),
          scientific(difference),
          format_bytes(double(r.bytes))};
}

}  // namespace

BenchReport bench_sparse(const BenchRequest& request, Backend& backend) {
  if (request.scene || !request.settings.empty())
    throw Error(request.scene ? "SCENE" : "--set", "this benchmark has its own scene", "leave it out");
  const Index G = request.quick ? 64 : 316, steps = request.steps > 0 ? request.steps : 1000;
  BenchReport report;
  report.scene = "cooled-plate";
  report.parameters = {{"contacts", contacts}, {"compliance", compliance}, {"obstacle", obstacle}, {"T", end}};
  report.details["seconds"] = "wall clock of the whole solve; setup holds the shifted solves and the lag weights";
  report.details["difference_max"] = "y against y of the same grid with a dense A, over t >= T/16";
  report.details["contact_share"] = "share of the values of y that are positive";

  std::vector<std::vector<std::string>> lines{
      {"m", "A", "status", "setup", "solve", "kernel error", "difference", "memory"}};
  const auto add = [&](const char* contestant, Index points, Index nonzeros, const SparseRun& run, double difference) {
    report.rows.push_back(row(contestant, points, nonzeros, run, difference));
    lines.push_back(cells(contestant, points, run, difference));
  };
  const Scene small = cooled_plate(small_grid);
  Scene twin = small;
  twin.dynamics = to_dense(small.dynamics);
  const SparseRun sparse = measure(small, backend, Method::march, steps, request.repeats()),
                  dense = measure(twin, backend, Method::march, steps, request.repeats());
  const double apart = deviation(sparse.result.y, dense.result.y).max;
  add("sparse", small_grid, get<SparseDynamics>(small.dynamics).A.nonZeros(), sparse, apart);
  add("dense", small_grid, small_grid * small_grid * small_grid * small_grid, dense, apart);

  const Scene large = cooled_plate(G);
  const SparseRun run = measure(large, backend, Method::march, steps, 1);  // half a minute: one run is enough
  add("sparse", G, get<SparseDynamics>(large.dynamics).A.nonZeros(), run, std::nan(""));
  report.notes.push_back(fmt::format("{} states: {} for the kernel, {} for {} steps", G * G,
                                     format_seconds(median(run.samples.setup)),
                                     format_seconds(median(run.samples.solve)), steps));
  print(fmt::format("{} steps, {} contacts, {} threads\n", steps, contacts, backend.device().threads) + table(lines) +
        report.notes.back() + "\n");
  return report;
}

}  // namespace bromwich::app
