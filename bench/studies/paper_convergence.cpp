// Figures 4.1 and 4.6: how fast the iterates approach the converged solution.

#include "app/commands.hpp"
#include "bench/studies/paper.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr double stop = 1e-12;       ///< (4.1)
constexpr Index printed_nodes = 25;  ///< P of the contours in the bound

/// 1..12 one by one, then in growing strides, up to `last`.
std::vector<Index> sweeps_shown(Index last, bool all) {
  std::vector<Index> list;
  for (Index k = 1; k <= last; k += all || k < 12 ? 1 : std::max<Index>(1, k / 8)) list.push_back(k);
  if (list.back() != last) list.push_back(last);
  return list;
}

/// The curve of one case: k and the errors of its iterates.
Json curve(Iterates& iterates, const std::vector<Index>& sweeps) {
  Json k = Json::array(), y = Json::array(), trace = Json::array(), x = Json::array();
  for (const Index i : sweeps) {
    const Iterates::Error& e = iterates.error(i);
    k.push_back(i);
    y.push_back(e.y);
    trace.push_back(e.trace);
    x.push_back(e.x);
  }
  return {{"sweeps", k}, {"error_y", y}, {"error_trace", trace}, {"error_x", x}};
}

/// The smallest C for which C^k/k! times the start bounds all measured errors of x.
double fitted_factor(const Json& row, double start) {
  double C = 0;
  for (std::size_t i = 0; i < row["sweeps"].size(); ++i) {
    const double k = row["sweeps"][i], e = row["error_x"][i];
    if (e > stop) C = std::max(C, std::exp((std::log(e / start) + std::lgamma(k + 1)) / k));
  }
  return C;
}

/// Mean factor of the error of x from one sweep to the next between two sweeps.
double decay(Iterates& iterates, Index from, Index to) {
  return std::pow(iterates.error(to).x / iterates.error(from).x, 1 / double(to - from));
}

std::string superlinear(const Scene& scene, Iterates& iterates, Index last, Index peak) {
  const Index middle = (peak + last) / 2;
  return fmt::format(
      "Fig. 4.1, {}, h = 1/{:g}: {} sweeps to (4.1); the error of x is largest after sweep {} ({:.1e}), then a sweep "
      "takes it to {:.2f} of itself in the first half of its way down and to {:.2f} in the second",
      scene.name, 1 / iterates.h(), last, peak, iterates.error(peak).x, decay(iterates, peak, middle),
      decay(iterates, middle, last));
}

Index peak_of(const Json& row) {
  std::size_t best = 0;
  for (std::size_t i = 0; i < row["error_x"].size(); ++i)
    if (row["error_x"][i] > row["error_x"][best]) best = i;
  return row["sweeps"][best];
}

}  // namespace

void paper_small_iterates(bool quick, Backend& backend, BenchReport& report) {
  const Scene scene = choose_scene("dlcp-small", {}).scene;
  std::vector<std::vector<std::string>> lines{{"h", "sweeps to 1e-12", "bound: phi", "L", "below 1 from sweep"}};
  for (const Index steps : {32, 128}) {
    Iterates iterates(scene, backend, steps, true);
    const Index last = iterates.sweeps_to(stop, [](const Iterates::Error& e) { return e.x; });
    const IterationBound bound = iteration_bound(scene, printed_nodes, steps, last);
    Json row{{"figure", "4.1"}, {"scene", scene.name}, {"steps", steps}, {"h", iterates.h()}};
    row.update(curve(iterates, sweeps_shown(last, !quick)));
    const double start = iterates.start_error(), fitted = fitted_factor(row, start);
    Json printed = Json::array();
    for (const Index k : row["sweeps"]) printed.push_back(bound.decades[std::size_t(k)] + std::log10(start));
    row.update({{"start_error", start},
                {"sweeps_to_1e-12", last},
                {"sweeps_to_1e-12_y", iterates.sweeps_to(stop, [](const Iterates::Error& e) { return e.y; })},
                {"bound_log10", printed},
                {"bound_phi", bound.phi},
                {"bound_lipschitz", bound.lipschitz},
                {"bound_factor", bound.factor},
                {"bound_useful_from", bound.useful_from()},
                {"fitted_factor", fitted}});
    lines.push_back({fmt::format("1/{}", steps), fmt::format("{}", last), fmt::format("{:.3g}", bound.phi),
                     fmt::format("{:.3g}", bound.lipschitz), fmt::format("{}", bound.useful_from())});
    report.notes.push_back(superlinear(scene, iterates, last, peak_of(row)));
    report.notes.push_back(fmt::format(
        "Fig. 4.1, h = 1/{}: with its constants computed (phi = {:.3g}, L = {:.3g}, phi L |B| |N| T = {:.3g}) the "
        "bound of Theorem 2.2 stays above the error of the start ({:.2g}) up to about sweep {:.2g}: it says nothing "
        "about the {} sweeps that are needed. A bound C^k/k! of the same form would hold with C = {:.3g}",
        steps, bound.phi, bound.lipschitz, bound.factor, start, double(bound.useful_from()), last, fitted));
    report.rows.push_back(std::move(row));
  }
  print("Fig. 4.1: iterates of dlcp-small (prescribed solution)\n" + table(lines) + "\n");
}

namespace {

/// (4.8) of the paper.
double paper_tolerance(double h, double dx) { return std::min(h, dx * dx) / 50; }

/// Whole states are compared where a grid has at most this many points per side; else their row at the membrane.
constexpr Index most_points_with_states = 39;

Json large_row(const char* figure, Index cells, Index steps, bool quick, Backend& backend) {
  const SceneChoice choice = choose_scene("signorini", {{"Q", double(cells - 1)}, {"T", horizon}});
  const double dx = 1 / double(cells);
  Iterates iterates(choice.scene, backend, steps, cells - 1 <= most_points_with_states);
  const double tolerance = paper_tolerance(iterates.h(), dx);
  // N = -2 (I ⊗ e_1^T): half the trace is the state next to the membrane.
  const auto neighbour = [](const Iterates::Error& e) { return e.trace / 2; };
  const Index last = iterates.sweeps_to(stop, neighbour);
  Json row{{"figure", figure}, {"scene", choice.scene.name}, {"steps", steps},        {"h", iterates.h()},
           {"dx", dx},         {"points", cells - 1},        {"tolerance", tolerance}};
  row.update(curve(iterates, sweeps_shown(last, false)));
  row["sweeps_to_tolerance"] = iterates.sweeps_to(tolerance, neighbour);
  row["sweeps_to_1e-12"] = last;
  row["sweeps_to_tolerance_x"] = nullptr;
  if (cells - 1 <= most_points_with_states && !quick)
    row["sweeps_to_tolerance_x"] = iterates.sweeps_to(tolerance, [](const Iterates::Error& e) { return e.x; });
  return row;
}

/// Least squares of count = a + b Q.
double growth_per_point(const std::vector<Json>& rows, const char* count) {
  double n = 0, q = 0, c = 0, qq = 0, qc = 0;
  for (const Json& row : rows) {
    const double Q = row["points"], k = row[count];
    n += 1, q += Q, c += k, qq += Q * Q, qc += Q * k;
  }
  return (n * qc - q * c) / (n * qq - q * q);
}

std::string counts(const std::vector<Json>& rows, const char* count, const char* of) {
  std::string text;
  for (const Json& row : rows)
    text += fmt::format("{}{} (1/{:.0f})", text.empty() ? "" : ", ", row[count].get<Index>(), 1 / double(row[of]));
  return text;
}

}  // namespace

void paper_large_iterates(bool quick, Backend& backend, BenchReport& report) {
  std::vector<Json> left, right;
  for (const Index per_unit : quick ? std::vector<Index>{25, 100} : std::vector<Index>{25, 50, 100, 200})
    left.push_back(large_row("4.6 left", 25, Index(horizon) * per_unit, quick, backend));
  for (const Index cells : quick ? std::vector<Index>{16, 40} : std::vector<Index>{16, 25, 32, 40, 64, 128, 256, 512})
    right.push_back(large_row("4.6 right", cells, 100 * Index(horizon), quick, backend));

  std::vector<std::vector<std::string>> lines{
      {"h", "dx", "tolerance (4.8)", "sweeps to it", "in all of x", "to 1e-12"}};
  for (const auto* rows : {&left, &right})
    for (const Json& row : *rows) {
      const Json& whole = row["sweeps_to_tolerance_x"];
      lines.push_back({fmt::format("1/{:.0f}", 1 / double(row["h"])), fmt::format("1/{:.0f}", 1 / double(row["dx"])),
                       scientific(row["tolerance"]), row["sweeps_to_tolerance"].dump(),
                       whole.is_null() ? "-" : whole.dump(), row["sweeps_to_1e-12"].dump()});
      report.rows.push_back(row);
    }
  print("Fig. 4.6: iterates of signorini\n" + table(lines) + "\n");
  report.notes.push_back(
      "Fig. 4.6 left, dx = 1/25: sweeps to 1e-12 at the steps in brackets: " + counts(left, "sweeps_to_1e-12", "h") +
      "; to (4.8): " + counts(left, "sweeps_to_tolerance", "h"));
  report.notes.push_back(
      fmt::format("Fig. 4.6 right, h = 1/100: sweeps to (4.8) at the spacings in brackets: {}; they grow by {:.2f} a "
                  "grid point of a side (to 1e-12: by {:.2f}), where the paper says 'somehow slightly increases'",
                  counts(right, "sweeps_to_tolerance", "dx"), growth_per_point(right, "sweeps_to_tolerance"),
                  growth_per_point(right, "sweeps_to_1e-12")));
}

}  // namespace bromwich::app
