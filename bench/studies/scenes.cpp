// Every scene file of a folder, solved by `auto`: properties of the scene, the choice, and the difference from the
// known values of the solution. Scenes without a solution, according to their reference, are included.

#include "app/commands.hpp"
#include "app/scene_facts.hpp"
#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "core/solve/solver.hpp"
#include "files/scene_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace bromwich::app {

std::vector<std::filesystem::path> scene_files(const std::string& place) {
  namespace fs = std::filesystem;
  if (fs::is_regular_file(place)) return {place};
  std::vector<fs::path> files;
  if (fs::is_directory(place))
    for (const auto& entry : fs::directory_iterator(place))
      if (entry.path().extension() == ".toml") files.push_back(entry.path());
  if (files.empty())
    throw Error("SCENE", fmt::format("found no scene files in '{}'", place),
                "name a scene file or a folder of them, such as the project's examples");
  std::sort(files.begin(), files.end(), [](const auto& a, const auto& b) { return a.stem() < b.stem(); });
  return files;
}

namespace {

/// The data of the row of one scene.
struct Outcome {
  std::string name;  ///< of the file; scenes in different files may have the same name
  SceneFile file;
  Result result;  ///< arrays dropped after the errors were taken
  double error_x = NAN, error_y = NAN;
  Samples samples;
};

/// Largest |found - expected| over known values of `expected`; infinite if `found` is NaN there; NaN if nothing is
/// known.
double largest_error(const Eigen::Ref<const Vector>& found, const Eigen::Ref<const Vector>& expected) {
  double largest = NAN;
  for (Index i = 0; i < expected.size(); ++i) {
    if (std::isnan(expected[i])) continue;
    const double error = std::abs(found[i] - expected[i]);
    largest = std::fmax(largest, std::isnan(error) ? INFINITY : error);
  }
  return largest;
}

/// Error relative to the exact solution over t >= T/16, up to the end of the result.
void compare_with_exact(Outcome& o) {
  const Scene& scene = o.file.scene;
  const Result& r = o.result;
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j < r.t.size(); ++j) {
    if (r.t[j] < scene.T / 16) continue;
    if (r.infeasible_at && r.t[j] >= *r.infeasible_at) return;
    scene.exact(r.t[j], x, y);
    o.error_x = std::fmax(o.error_x, largest_error(r.x.row(j).transpose(), x));
    o.error_y = std::fmax(o.error_y, largest_error(r.y.row(j).transpose(), y));
  }
}

/// Error relative to the given values at one time.
void compare_with_values(Backend& backend, Outcome& o) {
  const Reference& known = *o.file.reference;
  const Result there = at_times(o.file.scene, backend, o.result, {*known.t});
  const auto vector = [](const std::vector<double>& v) { return Eigen::Map<const Vector>(v.data(), Index(v.size())); };
  o.error_x = std::fmax(o.error_x, largest_error(there.x.row(0).transpose(), vector(known.x)));
  o.error_y = std::fmax(o.error_y, largest_error(there.y.row(0).transpose(), vector(known.y)));
}

Outcome run_scene(const std::filesystem::path& path, const BenchRequest& request, Backend& backend) {
  Outcome o{.name = path.stem(), .file = read_scene_file(path, request.settings), .result = {}, .samples = {}};
  const Scene& scene = o.file.scene;
  Options options;
  options.steps = request.steps;  // 0: the steps or the tolerance of the file
  options.states = StateSelection::all;
  check_memory(scene, request.steps > 0 ? request.steps : scene.steps(), scene.states());
  o.result = solve(scene, backend, options);
  const bool complete = o.result.x.rows() == o.result.y.rows() && o.result.y.rows() > 1;
  if (complete && scene.exact) compare_with_exact(o);
  if (complete && o.file.reference && o.file.reference->t) compare_with_values(backend, o);
  for (RowMatrix* array : {&o.result.y, &o.result.x}) array->resize(0, 0);
  options.states = StateSelection::none;
  for (int i = 0; i < request.repeats(); ++i) {
    const Seconds seconds = solve(scene, backend, options).seconds;
    o.samples.add(seconds.total, seconds.setup, seconds.solve);
  }
  return o;
}

std::string expected_status(const Outcome& o) { return o.file.reference ? o.file.reference->status : "solved"; }

double tolerance(const Outcome& o) { return o.file.reference ? o.file.reference->tolerance.value_or(NAN) : NAN; }

/// The status is the expected one, infeasibility is found within a step, and no error exceeds the tolerance of the
/// file.
bool as_expected(const Outcome& o) {
  if (o.file.reference && o.file.reference->infeasible_at) {
    const double h = o.file.scene.T / double(o.result.steps);
    if (!o.result.infeasible_at || std::abs(*o.result.infeasible_at - *o.file.reference->infeasible_at) > h)
      return false;
  }
  return expected_status(o) == to_string(o.result.status) && !(o.error_x > tolerance(o)) && !(o.error_y > tolerance(o));
}

std::vector<std::string> text_row(const Outcome& o) {
  const Scene& scene = o.file.scene;
  const std::string expected = expected_status(o), found = to_string(o.result.status);
  return {o.name,
          fmt::format("{}", scene.states()),
          fmt::format("{}", scene.constraints()),
          matrix_class(scene),
          to_string(o.result.method),
          fmt::format("{}", o.result.steps),
          scientific(o.error_x),
          scientific(o.error_y),
          scientific(tolerance(o)),
          found == expected ? found : fmt::format("{} (expected {})", found, expected),
          format_seconds(median(o.samples.total))};
}

Json json_row(const Outcome& o) {
  const Scene& scene = o.file.scene;
  const auto& known = o.file.reference;
  const auto time = [](const std::optional<double>& t) { return t ? Json(*t) : Json(nullptr); };
  return {{"scene", o.name},
          {"description", o.file.description},
          {"parameters", to_json(o.file.parameters)},
          {"states", scene.states()},
          {"constraints", scene.constraints()},
          {"class", matrix_class(scene)},
          {"spectrum", spectrum_text(scene)},
          {"method", to_string(o.result.method)},
          {"kernel", o.result.kernel},
          {"steps", o.result.steps},
          {"error_x", o.error_x},
          {"error_y", o.error_y},
          {"tolerance", tolerance(o)},
          {"residual", o.result.residual},
          {"status", to_string(o.result.status)},
          {"status_expected", expected_status(o)},
          {"infeasible_at", time(o.result.infeasible_at)},
          {"infeasible_at_expected", time(known ? known->infeasible_at : std::nullopt)},
          {"reason", o.result.reason},
          {"reference", known ? known->source : ""},
          {"as_expected", as_expected(o)},
          {"seconds", to_json(o.samples)}};
}

}  // namespace

BenchReport bench_scenes(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or(examples_folder);
  report.details["error"] =
      "max over the components known; over t >= T/16 where the exact solution is known, at one "
      "time where the file gives values";
  report.details["seconds"] = "wall clock of the whole solve without states; median, min and max";
  std::vector<std::vector<std::string>> text{
      {"scene", "m", "n", "class", "method", "steps", "error x", "error y", "tolerance", "status", "median"}};
  for (const auto& path : scene_files(report.scene)) {
    const Outcome outcome = run_scene(path, request, backend);
    text.push_back(text_row(outcome));
    report.rows.push_back(json_row(outcome));
    if (!as_expected(outcome))
      report.notes.push_back(fmt::format("{}: not as expected{}{}", outcome.name,
                                         outcome.result.reason.empty() ? "" : ": ", outcome.result.reason));
  }
  print_with_notes(table(text) + "\n", report);
  return report;
}

}  // namespace bromwich::app
