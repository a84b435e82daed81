// Estimated and true errors of error control: scenes with an exact or a converged solution are solved for tolerances
// from 1e-2 to 1e-7. The work is the number of steps of all grids together.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/tol_truth.hpp"
#include "core/base/error.hpp"
#include "core/result/located.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

namespace bromwich::app {

namespace {

constexpr double least_effectivity = 0.5, largest_effectivity = 3;  ///< limits of a good estimate
/// The error of a reference may be at most this part of the error to be measured.
constexpr double reference_share = 0.25;
/// Prescribed exact solutions are as accurate as the computation of their sources.
constexpr double rounding_level = 1e-10;

struct ToleranceLimits {
  double solve_seconds, reference_seconds, smallest_tolerance;
};
constexpr ToleranceLimits full{3, 10, 1e-7}, quick{2, 4, 1e-4};

struct Subject {
  SceneChoice choice;
  std::string name, method;
};

Subject built_in(const std::string& name, const ParameterValues& settings, const char* method) {
  Subject s{choose_initial_value_scene(name, settings), name, method};
  if (name == "signorini") s.name += fmt::format(", Q = {:g}", s.choice.parameters.at("Q"));
  return s;
}

std::vector<Subject> subjects(const BenchRequest& request) {
  std::vector<Subject> all;
  if (request.scene && !std::filesystem::exists(*request.scene))
    return {built_in(*request.scene, request.settings, "auto")};
  if (!request.scene) {
    if (!request.settings.empty()) throw Error("SCENE", "found none beside --set", "name the scene of the parameters");
    for (const double Q : {15, 39, 127}) all.push_back(built_in("signorini", {{"Q", Q}}, "auto"));
    for (const char* name : {"dlcp-small", "bridge"}) all.push_back(built_in(name, {}, "auto"));
    all.push_back(built_in("signorini", {{"Q", 15}}, "contour"));
    all.push_back(built_in("dlcp-small", {}, "euler"));
  }
  for (const auto& path : scene_files(request.scene.value_or(examples_folder))) {
    // The list of all scenes has each scene once: these files are built-in scenes, and rlcd.
    const std::string name = path.stem();
    if (!request.scene && (name == "bridge" || name == "dlcp-small" || name == "template")) continue;
    SceneChoice choice = choose_scene(path, request.settings);
    if (!choice.scene.boundary) all.push_back({std::move(choice), name, "auto"});
  }
  return all;
}

struct TolRun {
  double tolerance;
  Result result;
  double seconds;
};

/// Down to the smallest tolerance, or to the first that is not met.
std::vector<TolRun> runs(const Subject& subject, const BenchRequest& request, Backend& backend, Options options) {
  const ToleranceLimits& limits = request.quick ? quick : full;
  std::vector<TolRun> all;
  for (double tolerance = 1e-2; tolerance > 0.5 * limits.smallest_tolerance; tolerance /= 10) {
    options.tolerance = tolerance;
    options.steps = request.steps;
    const auto start = std::chrono::steady_clock::now();
    const auto elapsed = [start] {
      return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    };
    options.interrupted = [&] { return elapsed() > limits.solve_seconds; };
    Result result = solve(subject.choice.scene, backend, options);
    all.push_back({tolerance, std::move(result), elapsed()});
    if (all.back().result.status != Status::solved) break;
  }
  return all;
}

/// NaN if the reference does not know it.
double known(double error, double known_to) { return reference_share * error >= known_to ? error : NAN; }

/// NaN if the error is not known, or too small.
double effectivity(double estimate, double error) { return error > rounding_level ? estimate / error : NAN; }

struct Row {
  Json json;
  std::vector<std::string> text;
  bool counts;        ///< solved, and different from the result for the previous tolerance
  double of_y, of_x;  ///< effectivities
  double true_over_tolerance;
};

Row row(const Subject& subject, const TolRun& run, const std::optional<TolTruth>& truth) {
  const Result& r = run.result;
  const ErrorEstimate e = r.errors.value_or(ErrorEstimate{});
  const TolErrors none{NAN, NAN, NAN};
  const TolErrors error = truth ? truth->of(r) : none, known_to = truth ? truth->known_to() : none;
  const double y_known_to = e.of_integral ? known_to.mean : known_to.y;
  const double y = known(e.of_integral ? error.mean : error.y, y_known_to), x = known(error.x, known_to.x);
  const double estimate = r.errors ? e.total() : NAN;
  const double of_y = effectivity(estimate, y), of_x = effectivity(e.states, x);
  const Index work = std::accumulate(e.grids.begin(), e.grids.end(), Index(0));
  Row row;
  row.counts = r.status == Status::solved;
  row.of_y = of_y;
  row.of_x = of_x;
  row.true_over_tolerance = std::fmax(y, x) / run.tolerance;
  const auto effect = [](double value) { return std::isnan(value) ? std::string("-") : fmt::format("{:.2f}", value); };
  row.text = {subject.name,
              subject.method,
              fmt::format("{:.0e}", run.tolerance),
              to_string(r.status),
              fmt::format("{}", r.steps),
              fmt::format("{}", work),
              e.of_integral ? "mean" : "y",
              scientific(estimate),
              scientific(y),
              effect(of_y),
              scientific(e.states),
              scientific(x),
              effect(of_x)};
  row.json = {{"scene", subject.name},
              {"parameters", to_json(subject.choice.parameters)},
              {"method_asked", subject.method},
              {"method", to_string(r.method)},
              {"tolerance", run.tolerance},
              {"status", to_string(r.status)},
              {"reason", r.reason},
              {"steps", r.steps},
              {"grids", e.grids},
              {"work", work},
              {"of", e.of_integral ? "mean of y" : "y"},
              {"order", e.order},
              {"estimate", {{"y", estimate}, {"x", e.states}}},
              {"parts",
               {{"discretisation", e.discretisation},
                {"kernel", e.kernel},
                {"iteration", e.iteration},
                {"rounding", e.rounding}}},
              {"error", {{"y", y}, {"x", x}}},
              {"effectivity", {{"y", of_y}, {"x", of_x}}},
              {"reference", truth ? truth->source() : ""},
              {"reference_known_to", {{"y", y_known_to}, {"x", known_to.x}}},
              {"reference_from_file", truth ? truth->from_file() : NAN},
              {"seconds", run.seconds}};
  return row;
}

/// The effectivities of the results called solved, each once even if it meets several tolerances; and the number of
/// scenes for which all are good.
Json share(const std::vector<Row>& rows, std::vector<std::string>& notes) {
  Json json = Json::object();
  for (const auto& [name, member] : {std::pair("y", &Row::of_y), std::pair("x", &Row::of_x)}) {
    const auto is_good = [](double v) { return v >= least_effectivity && v <= largest_effectivity; };
    std::vector<double> values;
    std::map<std::pair<std::string, std::string>, bool> all_good;  // by scene and method
    for (const Row& row : rows) {
      if (!row.counts || std::isnan(row.*member)) continue;
      values.push_back(row.*member);
      const auto [scene, added] = all_good.try_emplace({row.text[0], row.text[1]}, true);
      scene->second = scene->second && is_good(row.*member);
    }
    const auto good = std::count_if(values.begin(), values.end(), is_good);
    const auto good_scenes = std::count_if(all_good.begin(), all_good.end(), [](const auto& s) { return s.second; });
    json[name] = {{"results", values.size()},    {"good", good},
                  {"scenes", all_good.size()},   {"good_scenes", good_scenes},
                  {"smallest", minimum(values)}, {"largest", maximum(values)}};
    if (!values.empty())
      notes.push_back(
          fmt::format("{}: estimate over true error between {:g} and {:g} in {} of {} results, in all of "
                      "{} of {} scenes; from {:.2f} to {:.1f}",
                      name, least_effectivity, largest_effectivity, good, values.size(), good_scenes, all_good.size(),
                      minimum(values), maximum(values)));
  }
  return json;
}

std::vector<Row> study(const Subject& subject, const BenchRequest& request, Backend& backend,
                       std::vector<std::string>& notes) {
  Options options;
  options.method = method_from_string(subject.method);
  if (subject.choice.scene.states() <= 256) options.states = StateSelection::all;
  const std::vector<TolRun> all = runs(subject, request, backend, options);
  std::optional<TolTruth> truth;
  options.method = Method::automatic;
  // For the finest result if possible, otherwise for the finest possible one.
  for (auto run = all.rbegin(); run != all.rend() && !truth; ++run) {
    const Result& r = run->result;
    if (!r.errors || r.y.rows() != r.steps + 1 || !r.y.allFinite()) continue;
    // No grid is as accurate as located switches.
    if (locates_switches(r) && !subject.choice.scene.exact) continue;
    const std::vector<Index>& grids = r.errors->grids;
    const Index finest = r.steps * ((std::max(grids.back(), r.steps) + r.steps - 1) / r.steps);  // of trees: steps
    const double seconds =
        run->seconds * double(finest) / double(std::accumulate(grids.begin(), grids.end(), Index(0)));
    try {
      truth.emplace(subject.choice, backend, options, finest, seconds,
                    (request.quick ? quick : full).reference_seconds);
    } catch (const Error& error) {
      notes.push_back(fmt::format("{}: {}", subject.name, error.what()));
    }
  }
  std::vector<Row> rows;
  for (const TolRun& run : all) {
    rows.push_back(row(subject, run, truth));
    if (&run != &all.front() && run.result.steps == (&run - 1)->result.steps) rows.back().counts = false;
  }
  return rows;
}

}  // namespace

BenchReport bench_tol(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or("all");
  report.details["error"] =
      "largest over the time points t > 0: of y (or of its mean over [0, t], where y jumps) relative to max(1, max "
      "|.|), "
      "of x the largest component, relative to max(1, its largest value)";
  report.details["effectivity"] =
      "estimate over true error; null where the reference is not known to a quarter of the error or it is at rounding "
      "level";
  report.details["work"] = "steps of all grids together";
  std::vector<std::vector<std::string>> text{{"scene", "asked", "tol", "status", "steps", "work", "of", "estimate",
                                              "error", "ratio", "x estimate", "x error", "x ratio"}};
  std::vector<Row> rows;
  for (const Subject& subject : subjects(request))
    for (Row& row : study(subject, request, backend, report.notes)) {
      text.push_back(row.text);
      report.rows.push_back(row.json);
      rows.push_back(std::move(row));
    }
  for (const Row& row : rows)
    if (row.counts && row.true_over_tolerance > 1)
      report.notes.push_back(fmt::format("{}: solved for {}, but the error is {:.2f} of that", row.text[0], row.text[2],
                                         row.true_over_tolerance));
  report.details["share"] = share(rows, report.notes);
  print_with_notes(table(text) + "\n", report);
  return report;
}

}  // namespace bromwich::app
