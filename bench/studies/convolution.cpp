// The two ways to apply the kernel of the signorini scene, timed inside the functional iteration: a chunked scan of
// compressed exponentials, and causal FFT convolution with one weight per lag.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace bromwich::app {

namespace {

/// Enough for a mean, and so few that hardly any row has settled and left the iteration. The first sweep starts from x0
/// without a kernel, and the residual needs one application at the end: as many applications as sweeps.
constexpr Index iterations = 10;

struct Contender {
  const char* name;
  ConvolutionChoice choice;
  std::vector<double> seconds = {};  ///< of one application, one value per repeat
  Samples solves = {};
  Result result = {};

  double typical() const { return median(seconds); }
};

Options contender_options(const Contender& c, Index steps) {
  Options options;
  options.method = Method::contour;
  options.steps = steps;
  options.tuning.convolution = c.choice;
  options.max_iterations = iterations;
  return options;
}

/// `result` keeps y of the warm-up: the two must agree before their times are compared.
void measure(std::array<Contender, 2>& pair, const Scene& scene, Backend& backend, Index steps, int repeats) {
  for (Contender& c : pair) c.result = solve(scene, backend, contender_options(c, steps));
  for (int round = 0; round < repeats; ++round)
    for (Contender& c : pair) {
      const Result run = solve(scene, backend, contender_options(c, steps));
      c.seconds.push_back(run.seconds.convolution / double(run.iterations));
      c.solves.add(run.seconds.total, run.seconds.setup, run.seconds.solve);
    }
}

double difference(const std::array<Contender, 2>& pair) { return deviation(pair[0].result.y, pair[1].result.y).max; }

Json row(const Contender& c, const SceneChoice& choice, Index steps, double apart) {
  return {{"contestant", c.name},
          {"parameters", to_json(choice.parameters)},
          {"method", to_string(c.result.method)},
          {"kernel", c.result.kernel},
          {"kernel_error", c.result.kernel_error},
          {"status", to_string(c.result.status)},
          {"steps", steps},
          {"iterations", c.result.iterations},
          {"difference_max", apart},
          {"residual", c.result.residual},
          {"seconds",
           {{"median", c.typical()},
            {"min", minimum(c.seconds)},
            {"max", maximum(c.seconds)},
            {"setup", median(c.solves.setup)},
            {"solve", median(c.solves.solve)}}},
          {"bytes", c.result.bytes}};
}

std::vector<std::string> cells(const Contender& c, Index points, Index steps, double apart) {
  const double values = double(points) * double(steps + 1);
  return {fmt::format("{}", points),
          fmt::format("{}", steps),
          c.name,
          format_seconds(c.typical()),
          format_seconds(minimum(c.seconds)),
          format_seconds(maximum(c.seconds)),
          fmt::format("{:.3g} ns", c.typical() / values * 1e9),
          format_seconds(median(c.solves.setup)),
          scientific(apart),
          format_bytes(double(c.result.bytes))};
}

void refuse_unused(const BenchRequest& request) {
  if (request.scene.value_or("signorini") != "signorini")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses signorini");
  if (!request.settings.empty() || request.steps > 0)
    throw Error(request.steps > 0 ? "--steps" : "--set", "this benchmark has its own sizes", "leave it out");
}

}  // namespace

BenchReport bench_convolution(const BenchRequest& request, Backend& backend) {
  refuse_unused(request);
  BenchReport report;
  report.scene = "signorini";
  report.details["seconds"] = fmt::format(
      "wall clock of one application of the kernel to the whole space-time array, mean of {} iterations; setup and "
      "solve are medians of those parts of the whole run",
      iterations);
  report.details["difference_max"] = "y of the scan against y of the FFT after the same iterations";
  const std::vector<double> points = request.quick ? std::vector<double>{39} : std::vector<double>{39, 127, 511};
  const std::vector<Index> grids = request.quick ? std::vector<Index>{400} : std::vector<Index>{400, 4096};

  std::vector<std::vector<std::string>> lines{
      {"Q", "J", "kernel", "median", "min", "max", "per value", "setup", "difference", "memory"}};
  for (const double Q : points)
    for (const Index steps : grids) {
      const SceneChoice choice = choose_scene(report.scene, {{"Q", Q}});
      std::array<Contender, 2> pair{{{"scan", ConvolutionChoice::scan}, {"fft", ConvolutionChoice::fft}}};
      measure(pair, choice.scene, backend, steps, request.repeats());
      const double apart = difference(pair);
      for (const Contender& c : pair) {
        lines.push_back(cells(c, choice.scene.constraints(), steps, apart));
        report.rows.push_back(row(c, choice, steps, apart));
      }
      const double ratio = pair[1].typical() / pair[0].typical();
      report.notes.push_back(fmt::format("Q = {}, J = {}: {} is {:.3g} x faster", Q, steps, ratio > 1 ? "scan" : "fft",
                                         std::max(ratio, 1 / ratio)));
      report.parameters = to_json(choice.parameters);
      report.parameters.erase("Q");
    }
  std::string text = fmt::format("one application of the kernel, {} threads\n", backend.device().threads);
  text += table(lines);
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
