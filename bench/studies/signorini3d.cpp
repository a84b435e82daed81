// Contact on a face: signorini3d by marching, cycles and implicit Euler. Values of y at two points of the face at T
// show that all methods find the same solution; whole solves are timed, with the work that cycles count.

#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr double useful_share_of_face = 0.05;  ///< algebraic error relative to the discretisation error
/// J Q^2 up to which a contestant runs: about ten seconds.
constexpr double most_on_host = 5e6, most_marched_on_host = 3e6, most_on_device = 3e8, most_marched_on_device = 3e8;

struct FaceGrid {
  double Q;
  Index J;
  double values() const { return double(J) * Q * Q; }
};

std::vector<FaceGrid> grids_of_faces(bool quick) {
  if (quick) return {{7, 32}, {15, 64}};
  return {{15, 64}, {31, 256}, {63, 1024}, {127, 1024}, {127, 4096}, {255, 1024}, {255, 4096}};
}

struct FaceContestant {
  const char* name;
  Options options;
};

std::vector<FaceContestant> contestants_on_faces(Index J) {
  std::vector<FaceContestant> list{{"multigrid to 1e-12", {}}, {"multigrid", {}}, {"march", {}}, {"euler", {}}};
  for (FaceContestant& c : list) {
    c.options.steps = J;
    c.options.method = Method::multigrid;
  }
  list[1].options.tuning.algebraic_share = useful_share_of_face;
  list[2].options.method = Method::march;
  list[3].options.method = Method::euler;
  return list;
}

class FaceStudy {
 public:
  FaceStudy(Backend& backend, int repeats, BenchReport& report)
      : backend_(backend), repeats_(repeats), report_(report) {}

  void run(const FaceGrid& size) {
    const bool host = backend_.name() == "cpu";
    if (size.values() > (host ? most_on_host : most_on_device)) return;
    const Scene scene = make_scene("signorini3d", {{"Q", size.Q}});
    for (const FaceContestant& c : contestants_on_faces(size.J)) {
      const bool marches = c.options.method == Method::march || c.options.method == Method::euler;
      if (marches && size.values() > (host ? most_marched_on_host : most_marched_on_device)) continue;
      measure(scene, size, c);
    }
  }

  const std::vector<std::vector<std::string>>& lines() const { return lines_; }

 private:
  void measure(const Scene& scene, const FaceGrid& size, const FaceContestant& c) {
    Samples samples;
    Result result;
    try {
      for (int k = 0; k <= repeats_; ++k) {  // the first one warms up
        result = solve(scene, backend_, c.options);
        if (k > 0) samples.add(result.seconds.total, result.seconds.setup, result.seconds.solve);
        if (result.seconds.total > 2 && k > 0) break;
      }
    } catch (const Error& error) {
      report_.rows.push_back({{"backend", backend_.name()},
                              {"Q", size.Q},
                              {"steps", size.J},
                              {"contestant", c.name},
                              {"skipped", error.what()}});
      return;
    }
    add(size, c, result, samples);
  }

  // y at T, at the points (Q/2, Q/2) and (Q/2, Q/4 + 1) of the face, counted from 0.
  static std::vector<double> probes(const Result& r, Index Q) {
    const Index last = r.y.rows() - 1, line = Q / 2 * Q;
    return {r.y(last, line + Q / 2), r.y(last, line + Q / 4 + 1)};
  }

  void add(const FaceGrid& size, const FaceContestant& c, const Result& r, const Samples& samples) {
    const std::vector<double> at = probes(r, Index(size.Q));
    report_.rows.push_back({{"backend", backend_.name()},
                            {"Q", size.Q},
                            {"steps", size.J},
                            {"contestant", c.name},
                            {"status", to_string(r.status)},
                            {"reason", r.reason},
                            {"kernel", r.kernel},
                            {"seconds", to_json(samples)},
                            {"repeats", samples.total.size()},
                            {"sweeps_seconds", r.seconds.sweeps},
                            {"cycles", r.cycles},
                            {"convolutions", r.convolutions},
                            {"passes", r.passes},
                            {"residual", r.residual},
                            {"algebraic_error", r.algebraic_error.value_or(NAN)},
                            {"discretisation_error", r.error_estimate.value_or(NAN)},
                            {"probes", at},
                            {"bytes", r.bytes}});
    const bool cycles = r.cycles > 0;
    lines_.push_back({backend_.name(), fmt::format("{}", size.Q), fmt::format("{}", size.J), c.name,
                      to_string(r.status), format_seconds(median(samples.setup)), format_seconds(median(samples.solve)),
                      cycles ? fmt::format("{}", r.cycles) : "-",
                      cycles ? fmt::format("{:.1f} + {:.1f}", r.convolutions, r.passes) : "-", scientific(r.residual),
                      fmt::format("{:.10f} {:.10f}", at[0], at[1])});
  }

  Backend& backend_;
  int repeats_;
  BenchReport& report_;
  std::vector<std::vector<std::string>> lines_{{"backend", "Q", "J", "method", "status", "set-up", "solve", "cycles",
                                                "convolutions + passes", "residual", "probes"}};
};

}  // namespace

BenchReport bench_signorini3d(const BenchRequest& request, Backend& backend) {
  if (request.scene.value_or("signorini3d") != "signorini3d")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses signorini3d");
  BenchReport report;
  report.scene = "signorini3d";
  report.details["multigrid"] = fmt::format(
      "the run that stops where its estimate of the algebraic error is below {} of its estimate of the discretisation "
      "error",
      useful_share_of_face);
  report.details["convolutions, passes"] =
      "applications of K, and passes over all unknowns by sweeps, on all grids and with the nested start, in units of "
      "the finest grid";
  report.details["probes"] = "y at T at the points (Q/2, Q/2) and (Q/2, Q/4 + 1) of the face, counted from 0";
  std::vector<FaceGrid> chosen = grids_of_faces(request.quick);
  if (request.settings.contains("Q")) chosen = {{request.settings.at("Q"), request.steps > 0 ? request.steps : 256}};
  const std::string text = on_each_backend(request, backend, report, [&](Backend& one) {
    FaceStudy study(one, std::min(request.repeats(), 3), report);
    for (const FaceGrid& size : chosen) study.run(size);
    return table(study.lines());
  });
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
