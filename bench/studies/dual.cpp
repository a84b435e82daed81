// Cycles in w on contact: contraction of the cycles, cycles until the algebraic errors of w and of y are below a tenth
// of the discretisation error, plain sweeps beside them, and times compared with marching on one core.

#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr double wanted_contraction = 0.2;   ///< where c h/dx^2 is at least `crossed`
constexpr double crossed = 0.05;             ///< diffusion crosses a cell in a step
constexpr double least_change = 1e-10;       ///< smaller changes are not used for the contraction
constexpr double most_marched_values = 3e7;  ///< J Q^2 that one core marches in seconds

struct ContactGrid {
  double Q;
  Index J;
  double c, eps;
  double mu(double T) const { return c * T / double(J) * (Q + 1) * (Q + 1); }
};

std::vector<ContactGrid> contact_grids(bool quick) {
  if (quick) return {{15, 64, 0.05, 0}, {31, 256, 0.05, 1e-2}};
  std::vector<ContactGrid> all;
  for (const double Q : {15., 63., 255., 511., 1023.})
    for (const Index J : {256, 1024, 4096, 16384})
      for (const double c : {0.002, 0.05, 1.})
        for (const double eps : {0., 1e-2, 1e-1}) all.push_back({Q, J, c, eps});
  return all;
}

Options dual_options(Method method, Index J) {
  Options options;
  options.method = method;
  options.steps = J;
  return options;
}

// Geometric mean of the ratios of successive changes, and the largest of them.
struct Contraction {
  double mean = NAN, largest = 0;
};

Contraction dual_contraction(const Result& r) {
  double logarithms = 0;
  int count = 0;
  Contraction found;
  for (std::size_t k = 1; k < r.history.size() && r.history[k] > least_change; ++k, ++count) {
    const double ratio = r.history[k] / r.history[k - 1];
    logarithms += std::log(ratio);
    found.largest = std::max(found.largest, ratio);
  }
  if (count > 0) found.mean = std::exp(logarithms / count);
  return found;
}

class DualStudy {
 public:
  DualStudy(Backend& backend, int repeats, BenchReport& report)
      : backend_(backend), one_(make_cpu_backend(1)), repeats_(repeats), report_(report) {}

  void run(const ContactGrid& grid) {
    const Scene scene = make_scene("contact", {{"Q", grid.Q}, {"c", grid.c}, {"eps", grid.eps}});
    try {
      Samples samples;
      const Result cycles = timed(scene, backend_, Method::dual, grid.J, samples);
      Json row{{"backend", backend_.name()},
               {"Q", grid.Q},
               {"steps", grid.J},
               {"c", grid.c},
               {"eps", grid.eps},
               {"mu", grid.mu(scene.T)},
               {"status", to_string(cycles.status)},
               {"reason", cycles.reason},
               {"cycles", cycles.cycles},
               {"sweeps", cycles.iterations},
               {"kernel", cycles.kernel},
               {"residual", cycles.residual},
               {"error_estimate", cycles.error_estimate.value_or(NAN)},
               {"seconds", to_json(samples)}};
      const Contraction found = dual_contraction(cycles);
      row["contraction"] = {{"mean", found.mean}, {"largest", found.largest}};
      row["history"] = cycles.history;
      if (double(grid.J) * grid.Q * grid.Q <= most_marched_values) march(scene, grid, cycles, row);
      lines_.push_back({backend_.name(), fmt::format("{}", grid.Q), fmt::format("{}", grid.J),
                        fmt::format("{}", grid.c), fmt::format("{}", grid.eps), to_string(cycles.status),
                        fmt::format("{}", cycles.cycles), fmt::format("{:.3f}", found.mean),
                        fmt::format("{:.3f}", found.largest), format_seconds(median(samples.setup)),
                        format_seconds(median(samples.solve))});
      report_.rows.push_back(std::move(row));
    } catch (const Error& error) {
      report_.rows.push_back({{"backend", backend_.name()},
                              {"Q", grid.Q},
                              {"steps", grid.J},
                              {"c", grid.c},
                              {"eps", grid.eps},
                              {"skipped", error.what()}});
    }
  }

  const std::vector<std::vector<std::string>>& lines() const { return lines_; }

 private:
  Result timed(const Scene& scene, Backend& backend, Method method, Index J, Samples& samples) const {
    Result result;
    for (int k = 0; k <= repeats_; ++k) {  // the first one warms up
      result = solve(scene, backend, dual_options(method, J));
      if (k > 0 || repeats_ == 0) samples.add(result.seconds.total, result.seconds.setup, result.seconds.solve);
    }
    return result;
  }

  // On one core: the same discrete solution by implicit Euler, and Radau IIA.
  void march(const Scene& scene, const ContactGrid& grid, const Result& cycles, Json& row) const {
    Samples euler, radau;
    const Result same = timed(scene, *one_, Method::euler, grid.J, euler);
    const Result better = timed(scene, *one_, Method::march, grid.J, radau);
    row["euler"] = {{"status", to_string(same.status)}, {"kernel", same.kernel}, {"seconds", to_json(euler)}};
    row["march"] = {{"status", to_string(better.status)}, {"kernel", better.kernel}, {"seconds", to_json(radau)}};
    if (same.status == Status::solved && cycles.status == Status::solved)
      row["difference_from_euler"] = (same.y - cycles.y).cwiseAbs().maxCoeff();
  }

  Backend& backend_;
  std::unique_ptr<Backend> one_;
  int repeats_;
  BenchReport& report_;
  std::vector<std::vector<std::string>> lines_{
      {"backend", "Q", "J", "c", "eps", "status", "cycles", "mean", "largest", "set-up", "solve"}};
};

std::vector<std::string> dual_notes(const Json& rows) {
  std::string slow, ended;
  double largest = 0;
  for (const Json& row : rows) {
    if (row.contains("skipped")) continue;
    const std::string name =
        fmt::format(" {} Q={} J={} c={} eps={}", row["backend"].get<std::string>(), row["Q"].get<double>(),
                    row["steps"].get<Index>(), row["c"].get<double>(), row["eps"].get<double>());
    if (row["status"] != "solved") ended += name;
    if (!(row["mu"].get<double>() >= crossed) || !row["contraction"]["mean"].is_number()) continue;
    const double mean = row["contraction"]["mean"];
    largest = std::max(largest, mean);
    if (!(mean <= wanted_contraction)) slow += name;
  }
  const auto missed = [](const std::string& names) { return names.empty() ? "nowhere" : "at" + names; };
  return {fmt::format("contraction of a cycle where c h/dx^2 >= {}: {:.3f} at most; {} missed {}", crossed, largest,
                      wanted_contraction, missed(slow)),
          fmt::format("not solved {}", missed(ended))};
}

}  // namespace

BenchReport bench_dual(const BenchRequest& request, Backend& backend) {
  if (request.scene.value_or("contact") != "contact")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses contact");
  for (const auto& [key, value] : request.settings)
    if (key != "Q" && key != "c" && key != "eps") throw Error("--set", "found '" + key + "'", "set Q, c or eps");
  BenchReport report;
  report.scene = "contact";
  report.details["contraction"] =
      fmt::format("mean (geometric) and largest quotient of the changes of w by consecutive cycles, those above {:g}",
                  least_change);
  report.details["mu"] = "c h/dx^2: how many cells diffusion crosses in a step, squared";
  report.details["euler"] = "implicit Euler step by step on one core, the same discrete problem";
  report.details["march"] = "Radau IIA on one core with as many steps";
  std::vector<ContactGrid> chosen = contact_grids(request.quick);
  for (ContactGrid& grid : chosen) {
    if (request.settings.contains("Q")) grid.Q = request.settings.at("Q");
    if (request.settings.contains("c")) grid.c = request.settings.at("c");
    if (request.settings.contains("eps")) grid.eps = request.settings.at("eps");
    if (request.steps > 0) grid.J = request.steps;
  }
  const auto same = [](const ContactGrid& a, const ContactGrid& b) {
    return a.Q == b.Q && a.J == b.J && a.c == b.c && a.eps == b.eps;
  };
  chosen.erase(std::unique(chosen.begin(), chosen.end(), same), chosen.end());

  const std::string text = on_both_backends(backend, report, [&](Backend& one) {
    DualStudy study(one, std::min(request.repeats(), 3), report);
    for (const ContactGrid& grid : chosen) study.run(grid);
    return table(study.lines());
  });
  report.notes = dual_notes(report.rows);
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
