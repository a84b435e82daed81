// How sweeps, cycles and grids converge, and the parts of the error.

#include "report/charts.hpp"
#include "report/page_parts.hpp"
#include "report/page_pieces.hpp"

#include <fmt/format.h>

#include <cmath>

namespace bromwich::report {

namespace {

Vector counted(std::size_t count) { return Vector::LinSpaced(Index(count), 1, double(count)); }

Vector as_vector(const std::vector<double>& values) {
  return Eigen::Map<const Vector>(values.data(), Index(values.size()));
}

std::string changes_figure(const Json& s, const std::vector<double>& history) {
  const bool cycles = number_at(s, "cycles").value_or(0) > 0;
  const char* one = cycles ? "cycle" : "sweep";
  LineChart chart{fmt::format("change of y in each {}", one), {one}, {"change of y", true}, {}, {}};
  chart.lines.push_back({"largest change", counted(history.size()), as_vector(history), false, history.size() <= 60});
  if (const auto tolerance = number_at(s, "requested/iteration_tolerance"))
    chart.levels.push_back({*tolerance, "iteration tolerance " + number(*tolerance)});
  return figure(line_chart(chart), fmt::format("Largest change of y in each of {} {}{}, relative to max(1, |y|).",
                                               history.size(), one, history.size() == 1 ? "" : "s"));
}

std::string grids_figure(const Json& s, const std::vector<double>& grids, const std::vector<double>& estimates) {
  LineChart chart{"estimated error of each grid", {"time steps", true}, {"estimated error", true}, {}, {}};
  Line line{"estimated error", as_vector(grids), as_vector(estimates), false, true};
  chart.lines.push_back(std::move(line));
  if (const auto tolerance = number_at(s, "errors/tolerance"))
    chart.levels.push_back({*tolerance, "tolerance " + number(*tolerance)});
  std::string words;
  for (const double J : grids) words += fmt::format("{}{:.0f}", words.empty() ? "" : ", ", J);
  return figure(line_chart(chart),
                "Grids of " + words + " steps. The first ones have no estimate: it needs grids to compare.");
}

std::string goal_figure(const Json& s) {
  std::vector<double> cells, quantity, estimate;
  for (const Json& cycle : s["goal"]["history"]) {
    cells.push_back(number_at(cycle, "steps").value_or(NAN));
    quantity.push_back(std::abs(number_at(cycle, "quantity").value_or(NAN)));
    estimate.push_back(std::abs(number_at(cycle, "estimate").value_or(NAN)));
  }
  const std::string name = text_at(s, "goal/quantity");
  LineChart chart{"quantity of interest on each grid", {"time steps", true}, {"modulus", true}, {}, {}};
  chart.lines.push_back({"quantity " + name, as_vector(cells), as_vector(quantity), false, true});
  chart.lines.push_back({"estimated error of it", as_vector(cells), as_vector(estimate), false, true});
  return figure(line_chart(chart), fmt::format("The quantity of interest and its estimated error on {} grids, each "
                                               "refined where the error comes from.",
                                               cells.size()));
}

}  // namespace

std::string convergence_part(const Report& report) {
  const Json& s = report.summary;
  std::string html;
  const auto drawn = [](const std::vector<double>& v) {
    return std::count_if(v.begin(), v.end(), [](double x) { return std::isfinite(x) && x > 0; });
  };
  const bool goal = s.is_object() && s.contains("goal") && s["goal"].is_object() && s["goal"].contains("history");
  if (const auto history = numbers_at(s, "history"); !goal && drawn(history) > 1) html += changes_figure(s, history);
  const auto grids = numbers_at(s, "errors/grids"), estimates = numbers_at(s, "errors/estimates");
  if (grids.size() > 1 && grids.size() == estimates.size() && drawn(estimates) > 0)
    html += grids_figure(s, grids, estimates);
  if (goal && s["goal"]["history"].size() > 1) html += goal_figure(s);
  return html.empty() ? "" : heading("Convergence") + html;
}

std::string error_part(const Report& report) {
  const Json& s = report.summary;
  NumberBars chart{"parts of the estimated error", "estimated error, relative", {}, {}};
  for (const auto& [key, name] : {std::pair("discretisation", "steps, of y"),
                                  {"states", "steps, of x"},
                                  {"kernel", "weights of the kernel"},
                                  {"iteration", "iteration"},
                                  {"rounding", "rounding"},
                                  {"interior", "between time points"}})
    if (const auto value = number_at(s, std::string("errors/") + key); value && *value > 0)
      chart.bars.emplace_back(name, *value);
  const auto tolerance = number_at(s, "errors/tolerance");
  if (chart.bars.empty() || !tolerance) return "";
  if (*tolerance > 0) chart.levels.push_back({*tolerance, "tolerance " + number(*tolerance)});
  const auto total = number_at(s, "error_estimate"), order = number_at(s, "errors/order");
  const std::string of = text_at(s, "error_estimate_of");
  std::string words = total ? fmt::format("The estimated error of {} is {}, {} the tolerance.", of.empty() ? "y" : of,
                                          number(*total), *total <= *tolerance ? "below" : "above")
                            : "The error could not be estimated.";
  if (order) words += fmt::format(" Halving the step was seen to reduce it with order {:.1f}.", *order);
  return heading("Error and tolerance") + figure(number_bars(chart), words);
}

}  // namespace bromwich::report
