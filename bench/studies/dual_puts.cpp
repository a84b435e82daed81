#include "bench/studies/dual_puts.hpp"

#include "app/text.hpp"
#include "core/scene/component_names.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr double wanted_of_put = 1e-5;  ///< absolute, of the value at the spot, for the published values
constexpr const char* trees = "binomial trees, scripts/put_reference";

// A put with its value, known to `known_to`.
struct KnownPut {
  const char* scene;
  ParameterValues parameters;
  double value, known_to;
  const char* source;
  Index steps, points, quick_points;  ///< quick_points 0: not in a quick run
};

const std::vector<KnownPut>& known_puts() {
  static const std::vector<KnownPut> puts{
      {"put", {{"q", 0.05}, {"sigma", 0.25}}, 9.569445299, 1e-9, "published", 2000, 2000, 200},
      {"put", {}, 6.0903706, 1e-7, "published", 2000, 2000, 200},
      {"put", {{"S", 36}, {"K", 40}, {"r", 0.06}}, 4.4866744, 1e-7, "published", 2000, 2000, 200},
      {"put", {{"dividend", 0.02}, {"dividends", 2}}, 7.55751, 3.2e-4, trees, 2000, 2000, 200},
      {"put-on-two", {}, 11.98751, 5.7e-5, trees, 64, 60, 30},
      {"put-on-two", {{"basket", 0.5}}, 6.758345, 2e-5, trees, 64, 60, 30},
      {"put-on-two", {{"dividend", 0.02}, {"dividends", 2}}, 13.9515, 2.2e-3, trees, 64, 60, 0}};
  return puts;
}

// The value at the spot, today.
Result solved_put(const Scene& scene, Backend& backend, Method method, Index steps) {
  Options options;
  options.method = method;
  options.steps = steps;
  options.states = StateSelection::list;
  options.components = {find_state(scene, "spot")};
  return solve(scene, backend, options);
}

double at_the_spot(const Result& r) { return r.status == Status::solved ? r.x(r.x.rows() - 1, 0) : NAN; }

Json measured_put(const KnownPut& put, Method method, Index steps, Index points, Backend& backend) {
  ParameterValues parameters = put.parameters;
  parameters["points"] = double(points);
  const Scene scene = make_scene(put.scene, parameters);
  const Result r = solved_put(scene, backend, method, steps);
  return {{"put", true},
          {"backend", backend.name()},
          {"scene", put.scene},
          {"parameters", parameters},
          {"states", scene.states()},
          {"steps", steps},
          {"method_asked", to_string(method)},
          {"method", to_string(r.method)},
          {"kernel", r.kernel},
          {"status", to_string(r.status)},
          {"value", at_the_spot(r)},
          {"reference", put.value},
          {"reference_known_to", put.known_to},
          {"source", put.source},
          {"error", std::abs(at_the_spot(r) - put.value)},
          {"seconds", r.seconds.total}};
}

}  // namespace

std::vector<std::vector<std::string>> measure_puts(bool quick, BenchReport& report) {
  std::vector<std::vector<std::string>> lines{
      {"put", "method", "states", "steps", "value", "error", "known to", "status", "time"}};
  const auto one = make_cpu_backend(1);
  for (const KnownPut& put : known_puts()) {
    if (quick && put.quick_points == 0) continue;
    const Index points = quick ? put.quick_points : put.points, steps = quick ? put.steps / 8 : put.steps;
    std::vector<Json> rows{measured_put(put, Method::automatic, steps, points, *one)};
    // Marching in y has full matrices: fewer points and steps, for the times.
    const Index few = std::min<Index>(points, put.scene == std::string("put") ? 300 : 16),
                short_run = std::max<Index>(8, steps / 10 / 4 * 4);
    for (const Method method : {Method::march, Method::dual})
      rows.push_back(measured_put(put, method, short_run, few, *one));
    for (Json& row : rows) {
      lines.push_back(
          {put.scene, fmt::format("{} ({})", row["method_asked"].get<std::string>(), row["method"].get<std::string>()),
           fmt::format("{}", row["states"].get<Index>()), fmt::format("{}", row["steps"].get<Index>()),
           fmt::format("{:.7f}", row["value"].get<double>()), fmt::format("{:.1e}", row["error"].get<double>()),
           fmt::format("{:.0e}", put.known_to), row["status"], format_seconds(row["seconds"])});
      report.rows.push_back(std::move(row));
    }
  }
  return lines;
}

std::string note_on_puts(const Json& rows) {
  double largest = 0;
  int count = 0;
  for (const Json& row : rows)
    if (row.contains("put") && row["source"] == "published" && row["method_asked"] == "auto") {
      const double error = row["error"];
      largest = std::isnan(error) ? error : std::max(largest, error);
      ++count;
    }
  return fmt::format("{} published values of American puts: error {:.1e} at most, {:.0e} wanted", count, largest,
                     wanted_of_put);
}

}  // namespace bromwich::app
