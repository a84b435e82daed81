// The paper to the letter, contour-literal with P + 1 shifted solves for every time point, on one core, on all cores
// and on a CUDA device if there is one, beside the iteration with shared contours and marching; on signorini, with the
// error that each one reaches.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

namespace bromwich::app {

namespace {

struct Place {
  const char* name;
  Backend* backend;
};

struct LiteralContestant {
  Place place;
  Options options;
  Result result = {};  ///< of the warm-up, arrays dropped
  Deviation error = {};
  Samples samples = {};
  std::vector<double> responses = {};  ///< seconds of the convolutions of all sweeps
};

struct Size {
  double Q;
  Index J;
};

constexpr double most_on_one_core = 60e3;  ///< time points times constraints; above, a solve takes minutes

std::vector<LiteralContestant> contestants(const Scene& scene, Index J, const std::vector<Place>& places) {
  const auto& d = get<KroneckerDynamics>(scene.dynamics);
  Options options;
  options.steps = J;
  options.iteration_tolerance = std::min(scene.T / double(J), d.along.spacing * d.along.spacing) / 50;  // (4.8)
  std::vector<LiteralContestant> list;
  for (const Place& place : places) {
    for (const Method method : {Method::march, Method::contour}) {
      options.method = method;
      list.push_back({place, options});
    }
    if (place.backend->threads() == 1 && double(J) * double(scene.constraints()) > most_on_one_core) continue;
    options.method = Method::contour_literal;
    for (const Index P : {25, 64}) {
      options.tuning.literal_nodes = P;
      list.push_back({place, options});
    }
    options.tuning.literal_nodes = Tuning().literal_nodes;
  }
  return list;
}

void measure(std::vector<LiteralContestant>& list, const Scene& scene, const Truth& truth, int repeats) {
  for (LiteralContestant& c : list) {
    c.result = solve(scene, *c.place.backend, c.options);
    c.error = truth.of(c.result).y;
    for (RowMatrix* array : {&c.result.y, &c.result.x}) array->resize(0, 0);
  }
  for (int round = 0; round < repeats; ++round)
    for (LiteralContestant& c : list) {
      if (c.result.seconds.total > 1 && round > 0) continue;  // long runs are timed once more only
      const Seconds seconds = solve(scene, *c.place.backend, c.options).seconds;
      c.samples.add(seconds.total, seconds.setup, seconds.solve);
      c.responses.push_back(seconds.sweeps);
    }
}

bool iterates(const LiteralContestant& c) { return c.options.method != Method::march; }

Json row(const LiteralContestant& c, const Size& size, const Truth& truth) {
  const Result& r = c.result;
  return {{"Q", size.Q},
          {"steps", size.J},
          {"method", to_string(c.options.method)},
          {"place", c.place.name},
          {"backend", r.backend},
          {"threads", c.place.backend->threads()},
          {"literal_nodes",
           c.options.method == Method::contour_literal ? Json(c.options.tuning.literal_nodes) : Json(nullptr)},
          {"status", to_string(r.status)},
          {"iterations", iterates(c) ? Json(r.iterations) : Json(nullptr)},
          {"iteration_tolerance", iterates(c) ? Json(c.options.iteration_tolerance) : Json(nullptr)},
          {"error_max", c.error.max},
          {"reference_known_to", truth.known_to().y.max},
          {"residual", r.residual},
          {"seconds", to_json(c.samples)},
          {"sweeps_seconds", iterates(c) ? Json(median(c.responses)) : Json(nullptr)},
          {"repeats", c.samples.total.size()},
          {"bytes", r.bytes}};
}

std::vector<std::string> line(const LiteralContestant& c, const Size& size) {
  const bool literal = c.options.method == Method::contour_literal;
  return {to_string(c.options.method),
          literal ? fmt::format("{}", c.options.tuning.literal_nodes) : "-",
          c.place.name,
          fmt::format("{:g}", size.Q),
          fmt::format("{}", size.J),
          to_string(c.result.status),
          iterates(c) ? fmt::format("{}", c.result.iterations) : "-",
          scientific(c.error.max),
          format_seconds(median(c.samples.setup)),
          iterates(c) ? format_seconds(median(c.responses)) : "-",
          format_seconds(median(c.samples.total))};
}

std::vector<Size> sizes(const BenchRequest& request) {
  std::vector<Size> list{{39, 400}, {63, 400}, {127, 400}, {127, 1600}};
  if (request.quick) list = {{15, 64}};
  const auto Q = request.settings.find("Q");
  for (Size& size : list) {
    if (Q != request.settings.end()) size.Q = Q->second;
    if (request.steps > 0) size.J = request.steps;
  }
  if (Q != request.settings.end() || request.steps > 0) list.resize(1);
  return list;
}

}  // namespace

BenchReport bench_literal(const BenchRequest& request, Backend& backend) {
  if (request.scene && *request.scene != "signorini")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses signorini");
  for (const auto& [key, value] : request.settings)
    if (key != "Q") throw Error("--set", "found '" + key + "'", "set Q, or nothing");
  const auto alone = make_cpu_backend(1);
  std::vector<Place> places{{"one core", alone.get()}};
  if (backend.threads() > 1) places.push_back({"all cores", &backend});
  BenchReport report;
  report.scene = "signorini";
  std::unique_ptr<Backend> cuda;
  if (!cuda_devices().empty()) {
    cuda = make_cuda_backend(make_cpu_backend(backend.threads()));
    places.push_back({"device", cuda.get()});
    report.parameters["device"] = cuda->device().name;
  }
  report.details["seconds"] = "wall clock of whole solves without output, all contestants of a size interleaved";
  report.details["sweeps_seconds"] = "the iteration without its first batch of complementarity problems";
  report.details["iteration_tolerance"] = "min(h, dx^2)/50, (4.8) of the paper";
  report.details["error_max"] = error_definition;
  std::vector<std::vector<std::string>> lines{
      {"method", "P", "on", "Q", "J", "status", "sweeps", "error", "setup", "in sweeps", "total"}};
  for (const Size& size : sizes(request)) {
    const Scene scene = make_scene("signorini", {{"Q", size.Q}});
    const Truth truth(scene, backend, size.J * (size.J > 400 ? 4 : 16));
    std::vector<LiteralContestant> list = contestants(scene, size.J, places);
    measure(list, scene, truth, request.repeats());
    for (const LiteralContestant& c : list) {
      report.rows.push_back(row(c, size, truth));
      lines.push_back(line(c, size));
    }
  }
  print(table(lines));
  return report;
}

}  // namespace bromwich::app
