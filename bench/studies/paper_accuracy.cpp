// Figure 4.3: error over the step, and over the nodes of a contour.

#include "app/commands.hpp"
#include "bench/studies/paper.hpp"
#include "core/dynamics/spectrum.hpp"
#include "core/numerics/contour.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

namespace bromwich::app {

namespace {

constexpr Index step_study_nodes = 64;    ///< P in the left panel
constexpr Index node_study_steps = 1024;  ///< the paper has 1e5 in the right panel

Options options_of(Method method, Index steps, Index nodes) {
  Options options;
  options.method = method;
  options.steps = steps;
  options.tuning.literal_nodes = nodes;
  options.trace = true;
  return options;
}

/// log2 of the error at h over that at h/2.
Json order(const Json& coarse, const Json& fine) {
  if (!coarse.is_number() || !fine.is_number()) return nullptr;
  const double value = std::log2(double(coarse) / double(fine));
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

std::string cell(const Json& value, const char* format) {
  return value.is_number() && std::isfinite(double(value)) ? fmt::format(fmt::runtime(format), double(value)) : "-";
}

/// One step of the left panel: the paper's difference between h and h/2, and the true error.
Json step_row(Method method, const Result& coarse, const Result& fine, const Truth& truth, const Scene& scene) {
  const Errors errors = truth.of(coarse);
  const bool both = coarse.status == Status::solved && fine.status == Status::solved;
  return {{"figure", "4.3 left"},
          {"scene", scene.name},
          {"method", to_string(method)},
          {"steps", coarse.steps},
          {"h", scene.T / double(coarse.steps)},
          {"nodes", method == Method::contour_literal ? Json(step_study_nodes) : Json(nullptr)},
          {"status", to_string(coarse.status)},
          {"reason", coarse.reason},
          {"sweeps", coarse.iterations},
          {"difference_y", both ? largest_difference(coarse.y, common_rows(fine.y, 2)) : NAN},
          {"difference_trace", both ? largest_difference(coarse.trace, common_rows(fine.trace, 2)) : NAN},
          {"error_y", coarse.status == Status::solved ? errors.y.max : NAN},
          {"error_trace", coarse.status == Status::solved ? errors.trace.max : NAN}};
}

/// Orders between neighbours, and a note with the order over the whole range.
std::string step_note(const std::vector<Json>& rows) {
  const Json *first = nullptr, *last = nullptr;
  std::string failed;
  for (const Json& row : rows) {
    if (row["status"] != "solved") failed += fmt::format("{}1/{}", failed.empty() ? "" : ", ", row["steps"].dump());
    if (!std::isfinite(double(row["error_y"])) || !std::isfinite(double(row["difference_y"]))) continue;
    if (!first) first = &row;
    last = &row;
  }
  const std::string method = rows.front()["method"];
  std::string text = "Fig. 4.3 left, " + method + ": ";
  if (first && first != last) {
    const double halvings = std::log2(double(last->at("steps")) / double(first->at("steps")));
    const auto mean = [&](const char* key) {
      return std::log2(double(first->at(key)) / double(last->at(key))) / halvings;
    };
    text += fmt::format(
        "mean order from h = 1/{} to 1/{}: differences of y {:.2f}, of the trace {:.2f}; true errors of y {:.2f}, of "
        "the trace {:.2f} (the paper: O(h), bound 5h)",
        first->at("steps").dump(), last->at("steps").dump(), mean("difference_y"), mean("difference_trace"),
        mean("error_y"), mean("error_trace"));
  } else {
    text += "no two steps solved";
  }
  // With second order the difference is 3/4 of the error; it does not contain errors common to the two grids.
  if (last && double(last->at("error_y")) > 2 * double(last->at("difference_y")))
    text += fmt::format(
        "; at h = 1/{} the error of y is {:.2g} times the difference that stands for it, which cannot see the error of "
        "the contours",
        last->at("steps").dump(), double(last->at("error_y")) / double(last->at("difference_y")));
  return text + (failed.empty() ? "" : "; not solved at h = " + failed);
}

}  // namespace

void paper_step_errors(bool quick, Backend& backend, BenchReport& report) {
  const Scene scene = choose_scene("dlcp-small", {}).scene;
  const Truth truth(scene, backend, 0);
  const Index last = quick ? 64 : 512;
  std::vector<std::vector<std::string>> lines{
      {"method", "h", "eps_y", "order", "eps_trace", "order", "error y", "error trace", "5 h", "status"}};
  for (const Method method : {Method::contour_literal, Method::contour}) {
    std::vector<Json> rows;
    Result coarse = solve(scene, backend, options_of(method, 8, step_study_nodes));
    for (Index steps = 8; steps <= last; steps *= 2) {
      Result fine = solve(scene, backend, options_of(method, 2 * steps, step_study_nodes));
      rows.push_back(step_row(method, coarse, fine, truth, scene));
      coarse = std::move(fine);
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      Json& row = rows[i];
      for (const std::string of : {"y", "trace"})
        row["order_" + of] =
            i + 1 < rows.size() ? order(row["difference_" + of], rows[i + 1]["difference_" + of]) : Json(nullptr);
      lines.push_back({row["method"], "1/" + row["steps"].dump(), scientific(row["difference_y"]),
                       cell(row["order_y"], "{:.2f}"), scientific(row["difference_trace"]),
                       cell(row["order_trace"], "{:.2f}"), scientific(row["error_y"]), scientific(row["error_trace"]),
                       scientific(5 * double(row["h"])), row["status"]});
      report.rows.push_back(row);
    }
    report.notes.push_back(step_note(rows));
  }
  print(fmt::format("Fig. 4.3 left: dlcp-small, contour-literal with P = {}\n{}\n", step_study_nodes, table(lines)));
}

namespace {

/// e^{-2.06 sqrt P}/sqrt P, (2.8).
double printed_rate(Index P) { return std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P)); }

/// delta of the least-squares fit C e^{-delta sqrt P}/sqrt P to the kernel errors above rounding.
double fitted_rate(const std::vector<Json>& rows) {
  double n = 0, s = 0, e = 0, ss = 0, se = 0;
  for (const Json& row : rows) {
    const double P = row["nodes"], error = row["kernel_error"];
    if (!(error > 1e-12)) continue;
    const double root = std::sqrt(P), value = std::log(error * root);
    n += 1, s += root, e += value, ss += P, se += root * value;
  }
  return -(n * se - s * e) / (n * ss - s * s);
}

Json node_row(const Result& r, Index nodes, const Scene& scene, const Truth& truth) {
  const Errors errors = truth.of(r);
  return {{"figure", "4.3 right"},          {"scene", scene.name},
          {"method", to_string(r.method)},  {"steps", r.steps},
          {"h", scene.T / double(r.steps)}, {"nodes", nodes},
          {"status", to_string(r.status)},  {"reason", r.reason},
          {"kernel_error", r.kernel_error}, {"error_y", errors.y.max},
          {"error_trace", errors.trace.max}};
}

/// The smallest P for which the error is that of the step.
std::string at_the_floor(const std::vector<Json>& rows, double floor) {
  for (const Json& row : rows)
    if (double(row["error_y"]) <= 1.1 * floor)
      return fmt::format("From P = {} on the error of y is that of the step ({:.1e})", row["nodes"].dump(), floor);
  return fmt::format("At no P tried is the error of y down to that of the step ({:.1e})", floor);
}

void node_notes(const std::vector<Json>& rows, const Json& shared, double half_angle, BenchReport& report) {
  const Json &first = rows.front(), &last = rows.back();
  const auto over = [](const Json& row) { return double(row["kernel_error"]) / double(row["printed_rate"]); };
  const Index steps = shared["steps"], nodes = shared["nodes"];
  report.notes.push_back(
      fmt::format("Fig. 4.3 right, h = 1/{}: the kernel of contour-literal misses by C e^(-{:.2f} sqrt P)/sqrt P "
                  "(fit), not 2.06, the rate of real spectra: this one has half-angle {:.1f} degrees. Its error is "
                  "{:.2g} times the printed rate at P = {} and {:.2g} times at P = {}. {}",
                  steps, fitted_rate(rows), half_angle * 180 / std::numbers::pi, over(first), first["nodes"].dump(),
                  over(last), last["nodes"].dump(), at_the_floor(rows, shared["error_y"])));
  const double windows = std::ceil(std::log(double(steps)) / std::log(window_ratio));
  report.notes.push_back(
      fmt::format("Nodes: contour-literal solves P + 1 shifted systems for each of {} time points, {} at P = 25; "
                  "shared contours take {} nodes a window of ratio 5 for this spectrum, {:.0f} in all, with a kernel "
                  "error of {:.1e} (real spectra to 1e-12: {} nodes a window)",
                  steps, 26 * steps, nodes, double(nodes) * windows, double(shared["kernel_error"]),
                  contour_parameters(0, 1e-12)->P + 1));
}

}  // namespace

void paper_node_errors(bool quick, Backend& backend, BenchReport& report) {
  const Scene scene = choose_scene("dlcp-small", {}).scene;
  const Truth truth(scene, backend, 0);
  const Index steps = quick ? 64 : node_study_steps;
  const double half_angle = spectrum(scene.dynamics).half_angle;
  const Result contour = solve(scene, backend, options_of(Method::contour, steps, step_study_nodes));
  const Json shared = node_row(contour, contour_parameters(half_angle)->P + 1, scene, truth);
  std::vector<std::vector<std::string>> lines{
      {"P", "kernel error", "printed rate", "y from contour", "error y", "error trace", "status"}};
  std::vector<Json> rows;
  for (const Index P :
       quick ? std::vector<Index>{4, 9, 16} : std::vector<Index>{4, 6, 9, 12, 16, 20, 23, 30, 38, 50, 64, 100}) {
    const Result r = solve(scene, backend, options_of(Method::contour_literal, steps, P));
    Json row = node_row(r, P, scene, truth);
    row["difference_y"] = largest_difference(r.y, contour.y);
    row["difference_trace"] = largest_difference(r.trace, contour.trace);
    row["printed_rate"] = printed_rate(P);
    lines.push_back({fmt::format("{}", P), scientific(r.kernel_error), scientific(printed_rate(P)),
                     scientific(row["difference_y"]), scientific(row["error_y"]), scientific(row["error_trace"]),
                     to_string(r.status)});
    rows.push_back(std::move(row));
  }
  node_notes(rows, shared, half_angle, report);
  rows.push_back(shared);
  for (Json& row : rows) report.rows.push_back(std::move(row));
  print(fmt::format("Fig. 4.3 right: dlcp-small, {} steps, contour-literal\n{}\n", steps, table(lines)));
}

}  // namespace bromwich::app
