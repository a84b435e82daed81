// Cycles in w on contact: contraction of the cycles, cycles until the algebraic errors of w and of y are below a tenth
// of the discretisation error, plain sweeps beside them, and times compared with marching on one core.

#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace bromwich::app {

namespace {

constexpr double wanted_contraction = 0.2;     ///< where c h/dx^2 is at least `crossed`
constexpr double crossed = 0.05;               ///< diffusion crosses a cell in a step
constexpr double least_change = 1e-10;         ///< smaller changes are not used for the contraction
constexpr double most_marched_values = 3e7;    ///< J Q^2 that one core marches in seconds
constexpr double most_reference_values = 1e7;  ///< J Q of a reference
constexpr double wanted_error = 1e-4;          ///< of w, where times are compared
constexpr double most_cpu_values = 6e5;        ///< J Q of grids that the host cycles on, in a list of several
constexpr double longest_run = 4;              ///< seconds

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
    for (const Index J : {256, 4096})
      for (const double c : {0.002, 0.05, 1.})
        for (const double eps : {0., 1e-2}) all.push_back({Q, J, c, eps});
  for (const double Q : {127., 511.}) all.push_back({Q, 16384, 0.05, 0}), all.push_back({Q, 4096, 0.05, 1e-1});
  return all;
}

Options dual_options(Method method, Index J, bool by_euler = false) {
  Options options;
  options.method = method;
  options.steps = J;
  options.tuning.dual_by_euler = by_euler;
  return options;
}

// w at the time points, from the trace.
RowMatrix gap_of(const Scene& scene, const Result& r) {
  const Matrix M = to_dense(scene.M);
  RowMatrix w = r.trace + r.y * M.transpose();
  Vector g(scene.constraints());
  for (Index j = 0; j < w.rows(); ++j) {
    scene.g(r.t[j], g);
    w.row(j) += g.transpose();
  }
  return w;
}

// Largest difference at the time points that both have, from row 1 on.
double largest_difference(const RowMatrix& a, const RowMatrix& b) {
  const Index steps = std::min(a.rows(), b.rows()) - 1, A = (a.rows() - 1) / steps, B = (b.rows() - 1) / steps;
  double largest = 0;
  for (Index j = 1; j <= steps; ++j) largest = std::max(largest, (a.row(A * j) - b.row(B * j)).cwiseAbs().maxCoeff());
  return largest;
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
  DualStudy(Backend& backend, bool by_euler, int repeats, BenchReport& report)
      : backend_(backend), by_euler_(by_euler), one_(make_cpu_backend(1)), repeats_(repeats), report_(report) {}

  void run(const ContactGrid& grid) {
    const Scene scene = make_scene("contact", {{"Q", grid.Q}, {"c", grid.c}, {"eps", grid.eps}});
    try {
      Samples samples;
      Options options = dual_options(Method::dual, grid.J, by_euler_);
      options.trace = true;
      const Result cycles = timed(scene, backend_, options, samples);
      Json row{{"backend", backend_.name()},
               {"rule", by_euler_ ? "euler" : "radau"},
               {"Q", grid.Q},
               {"steps", grid.J},
               {"c", grid.c},
               {"eps", grid.eps},
               {"mu", grid.mu(scene.T)},
               {"forecast", forecast_of(cycles)},
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
      if (cycles.status == Status::solved) stop_early(scene, grid, cycles, row);
      if (double(grid.J) * grid.Q * grid.Q <= most_marched_values) march(scene, grid, cycles, row);
      lines_.push_back({backend_.name(), by_euler_ ? "euler" : "radau", fmt::format("{}", grid.Q),
                        fmt::format("{}", grid.J), fmt::format("{}", grid.c), fmt::format("{}", grid.eps),
                        to_string(cycles.status), fmt::format("{}", cycles.cycles), fmt::format("{:.3f}", found.mean),
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
  // What the result says of the cycles before they begin.
  static double forecast_of(const Result& r) {
    const std::string words = "forecast ";
    const std::size_t at = r.kernel.find(words);
    return at == std::string::npos ? NAN : std::atof(r.kernel.c_str() + at + words.size());
  }

  Result timed(const Scene& scene, Backend& backend, const Options& options, Samples& samples) const {
    Result result;
    for (int k = 0; k <= repeats_; ++k) {  // the first one warms up
      result = solve(scene, backend, options);
      if (k > 0 || repeats_ == 0) samples.add(result.seconds.total, result.seconds.setup, result.seconds.solve);
    }
    return result;
  }

  // Cycles that end where further ones are of no use: their sweeps, and the true errors of y and w. Discretisation
  // errors against the stages of Radau IIA on steps of a quarter.
  void stop_early(const Scene& scene, const ContactGrid& grid, const Result& cycles, Json& row) const {
    Options options = dual_options(Method::dual, grid.J, by_euler_);
    options.trace = true;
    options.tuning.algebraic_share = 0.1;
    const Result early = solve(scene, backend_, options);
    if (early.status != Status::solved || cycles.trace.rows() != cycles.y.rows()) return;
    const RowMatrix w = gap_of(scene, cycles);
    row["useful"] = {{"cycles", early.cycles},
                     {"sweeps", early.iterations},
                     {"algebraic_error_y", largest_difference(early.y, cycles.y)},
                     {"algebraic_error_w", largest_difference(gap_of(scene, early), w)}};
    if (4 * double(grid.J) * grid.Q > most_reference_values) return;
    Options finer = dual_options(Method::dual, 4 * grid.J);
    finer.trace = true;
    const Result reference = solve(scene, backend_, finer);
    if (reference.status != Status::solved) return;
    row["useful"]["error_y"] = largest_difference(reference.y, cycles.y);
    row["useful"]["error_w"] = largest_difference(gap_of(scene, reference), w);
    row["useful"]["error_integral_of_y"] = largest_difference(integral_of_y(reference), integral_of_y(cycles));
  }

  // On one core: the same discrete solution by implicit Euler, and Radau IIA.
  void march(const Scene& scene, const ContactGrid& grid, const Result& cycles, Json& row) const {
    Samples euler, radau;
    const Result same = timed(scene, *one_, dual_options(Method::euler, grid.J), euler);
    const Result better = timed(scene, *one_, dual_options(Method::march, grid.J), radau);
    row["euler"] = {{"status", to_string(same.status)}, {"kernel", same.kernel}, {"seconds", to_json(euler)}};
    row["march"] = {{"status", to_string(better.status)}, {"kernel", better.kernel}, {"seconds", to_json(radau)}};
    if (by_euler_ && same.status == Status::solved && cycles.status == Status::solved)
      row["difference_from_euler"] = (same.y - cycles.y).cwiseAbs().maxCoeff();
  }

  Backend& backend_;
  bool by_euler_;
  std::unique_ptr<Backend> one_;
  int repeats_;
  BenchReport& report_;
  std::vector<std::vector<std::string>> lines_{
      {"backend", "rule", "Q", "J", "c", "eps", "status", "cycles", "mean", "largest", "set-up", "solve"}};
};

// Times at equal error of w: steps are doubled until w is within `wanted_error` of a reference.
class EqualError {
 public:
  EqualError(Backend& backend, double Q, Index reference_steps, BenchReport& report)
      : backend_(backend),
        one_(make_cpu_backend(1)),
        scene_(make_scene("contact", {{"Q", Q}})),
        Q_(Q),
        report_(report),
        most_(reference_steps / 2) {
    Options options = dual_options(Method::dual, reference_steps);
    options.trace = true;
    const Result r = solve(scene_, backend, options);
    if (r.status == Status::solved) reference_ = gap_of(scene_, r);
  }

  void run(const std::string& name, bool here, Options options) {
    if (reference_.size() == 0) return;
    Backend& backend = here ? backend_ : *one_;
    for (Index J = 32; J <= most_; J *= 2) {
      options.steps = J;
      options.trace = true;
      Solver solver(scene_, backend, options);
      const Result first = solver.solve();
      const double error = first.status == Status::solved ? largest_difference(reference_, gap_of(scene_, first)) : NAN;
      if (!(error <= wanted_error) && J < most_ && first.seconds.total < longest_run) continue;
      Samples whole, prepared;
      for (int k = 0; k < 3 && first.seconds.total < longest_run; ++k) {
        Options plain = options;
        plain.trace = false;
        const Result once = solve(scene_, backend, plain);
        whole.add(once.seconds.total, once.seconds.setup, once.seconds.solve);
        solver.set_x0(scene_.x0);
        const Result again = solver.solve();
        prepared.add(again.seconds.total, again.seconds.setup, again.seconds.solve);
      }
      lines_.push_back({backend.name(), name, fmt::format("{}", Q_), fmt::format("{}", J), fmt::format("{:.1e}", error),
                        to_string(first.status), whole.total.empty() ? "-" : format_seconds(median(whole.total)),
                        prepared.total.empty() ? "-" : format_seconds(median(prepared.total))});
      report_.rows.push_back({{"equal_error", true},
                              {"backend", backend.name()},
                              {"method", name},
                              {"Q", Q_},
                              {"steps", J},
                              {"error_w", error},
                              {"status", to_string(first.status)},
                              {"first_seconds", first.seconds.total},
                              {"whole", to_json(whole)},
                              {"prepared", to_json(prepared)}});
      return;
    }
  }

  const std::vector<std::vector<std::string>>& lines() const { return lines_; }

 private:
  Backend& backend_;
  std::unique_ptr<Backend> one_;
  Scene scene_;
  double Q_;
  BenchReport& report_;
  Index most_;
  RowMatrix reference_;
  std::vector<std::vector<std::string>> lines_{
      {"backend", "method", "Q", "J", "error of w", "status", "whole", "prepared"}};
};

std::vector<std::string> dual_notes(const Json& rows) {
  std::string slow, ended;
  double largest = 0;
  for (const Json& row : rows) {
    if (row.contains("skipped") || row.contains("equal_error")) continue;
    const std::string name =
        fmt::format(" {} Q={} J={} c={} eps={}", row["backend"].get<std::string>(), row["Q"].get<double>(),
                    row["steps"].get<Index>(), row["c"].get<double>(), row["eps"].get<double>());
    if (row["status"] != "solved") ended += name;
    const double mean = row["contraction"]["mean"];
    if (!(row["mu"].get<double>() >= crossed) || !std::isfinite(mean)) continue;  // one cycle has no quotient
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

  const std::vector<double> sizes_compared = request.settings.contains("Q") ? std::vector{request.settings.at("Q")}
                                             : request.quick                ? std::vector{15.}
                                                                            : std::vector{127., 511.};
  const std::string text = on_both_backends(backend, report, [&](Backend& one) {
    std::string tables;
    for (const bool by_euler : {false, true}) {
      DualStudy study(one, by_euler, std::min(request.repeats(), 3), report);
      for (const ContactGrid& grid : chosen)
        if (one.name() != "cpu" || chosen.size() == 1 || grid.Q * double(grid.J) <= most_cpu_values) study.run(grid);
      tables += table(study.lines());
    }
    for (const double Q : sizes_compared) {
      EqualError times(one, Q, request.quick ? 1024 : 16384, report);
      Options cycles = dual_options(Method::dual, 0);
      cycles.iteration_tolerance = 0.01 * wanted_error;
      times.run("dual", true, cycles);
      cycles.tuning.dual_by_euler = true;
      times.run("dual by euler", true, cycles);
      times.run("march", false, dual_options(Method::march, 0));
      times.run("euler", false, dual_options(Method::euler, 0));
      tables += table(times.lines());
    }
    return tables;
  });
  report.notes = dual_notes(report.rows);
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
