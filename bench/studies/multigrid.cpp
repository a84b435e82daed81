// Multigrid in time on signorini: contraction of its cycles in runs to 1e-12 over a range of grids in space and time,
// and the cost until the algebraic error is below a tenth of the discretisation error, compared with the plain
// iteration.

#include "app/text.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace bromwich::app {

namespace {

constexpr double useful_share = 0.1;  ///< algebraic error relative to the discretisation error
constexpr double wanted_contraction = 0.1;
constexpr int wanted_sweeps = 20;
constexpr double least_change = 1e-10;  ///< smaller changes are not used for the contraction
constexpr double most_host_work = 5e9;  ///< J Q^2 that the CPU solves in about ten seconds
constexpr double most_plain_seconds = 2;
constexpr Index sampled_sweeps = 12;  ///< of which a sweep is timed

struct Grid {
  double Q;
  Index J;
  double work() const { return double(J) * Q * Q; }
};

// dx = 1/16 to 1/1024, and the grids of the paper; the cheap ones first.
std::vector<Grid> study_sizes(bool quick) {
  if (quick) return {{15, 192}, {31, 256}};  // three grids on a device too
  std::vector<Grid> all{{39, 400}, {511, 400}};
  for (const double Q : {15., 31., 63., 127., 255., 511., 1023.})
    for (const Index J : {256, 1024, 4096, 16384}) all.push_back({Q, J});
  std::stable_sort(all.begin(), all.end(), [](const Grid& a, const Grid& b) { return a.work() < b.work(); });
  return all;
}

Options on_grid(Method method, Index J) {
  Options options;
  options.method = method;
  options.steps = J;
  return options;
}

double contraction(const Result& r) {
  double largest = 0;
  for (std::size_t k = 1; k < r.history.size(); ++k)
    if (r.history[k] > least_change) largest = std::max(largest, r.history[k] / r.history[k - 1]);
  return largest;
}

// Largest |a_j - b_j| relative to max(1, |a_j|), the measure of Result::history.
double difference(const RowMatrix& a, const RowMatrix& b) {
  double largest = 0;
  for (Index j = 0; j < a.rows(); ++j)
    largest = std::max(largest, (a.row(j) - b.row(j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() /
                                    std::max(1.0, a.row(j).cwiseAbs().maxCoeff()));
  return largest;
}

// Seconds of a sweep of the plain iteration over the finest grid.
double sweep_seconds(const Scene& scene, Backend& backend, Index J) {
  Options options = on_grid(Method::contour, J);
  options.max_iterations = sampled_sweeps + 1;
  const Result r = solve(scene, backend, options);
  return r.seconds.sweeps / double(std::max<std::size_t>(1, r.history.size()));
}

/// Sweeps of the plain iteration to 1e-12; if counting takes long, the number for fewer steps is used.
struct PlainSweeps {
  Index sweeps = 0, steps = 0;
};

/// Seconds.
struct Work {
  double all_grids = 0;  ///< of the nested start and the cycles
  double sweep = 0;      ///< one of the plain iteration over the finest
};

class Study {
 public:
  Study(Backend& backend, int repeats, BenchReport& report) : backend_(backend), repeats_(repeats), report_(report) {}

  void run(const Grid& size) {
    if (backend_.name() == "cpu" && size.work() > most_host_work) return skip(size, "takes the processor too long");
    const Scene scene = make_scene("signorini", {{"Q", size.Q}});
    Options useful = on_grid(Method::multigrid, size.J);
    useful.tuning.algebraic_share = useful_share;
    Result exact, stopped;
    std::vector<double> all_grids, sweep;
    try {
      exact = solve(scene, backend_, on_grid(Method::multigrid, size.J));
      for (int k = 0; k <= repeats_; ++k) {  // the first one warms up
        stopped = solve(scene, backend_, useful);
        if (k == 0 && repeats_ > 0) continue;
        samples_.add(stopped.seconds.total, stopped.seconds.setup, stopped.seconds.solve);
        all_grids.push_back(stopped.seconds.sweeps);
        sweep.push_back(sweep_seconds(scene, backend_, size.J));
      }
    } catch (const Error& error) {
      return skip(size, error.what());
    }
    add(size, exact, stopped, {median(all_grids), median(sweep)}, plain(scene, size, median(sweep)));
    samples_ = {};
  }

  const std::vector<std::vector<std::string>>& lines() const { return lines_; }

 private:
  void skip(const Grid& size, const std::string& why) {
    report_.rows.push_back({{"backend", backend_.name()}, {"Q", size.Q}, {"steps", size.J}, {"skipped", why}});
  }

  PlainSweeps plain(const Scene& scene, const Grid& size, double sweep) {
    PlainSweeps& known = plain_[size.Q];
    const double expected = double(known.sweeps) * sweep;
    if (known.sweeps > 0 && expected > most_plain_seconds) return known;
    const Result r = solve(scene, backend_, on_grid(Method::contour, size.J));
    if (r.status == Status::solved) known = {r.iterations, size.J};
    return known;
  }

  void add(const Grid& size, const Result& exact, const Result& stopped, const Work& work, const PlainSweeps& plain) {
    const double left = difference(exact.y, stopped.y), error = exact.error_estimate.value_or(NAN);
    const double equivalents = work.all_grids / work.sweep;
    report_.rows.push_back({{"backend", backend_.name()},
                            {"Q", size.Q},
                            {"steps", size.J},
                            {"grids", stopped.kernel},
                            {"status", to_string(exact.status)},
                            {"cycles", exact.cycles},
                            {"sweeps", exact.iterations},
                            {"contraction", contraction(exact)},
                            {"seconds_to_1e-12", exact.seconds.solve},
                            {"useful",
                             {{"status", to_string(stopped.status)},
                              {"cycles", stopped.cycles},
                              {"sweeps", stopped.iterations},
                              {"algebraic_error", left},
                              {"algebraic_error_estimated", stopped.algebraic_error.value_or(NAN)},
                              {"discretisation_error", error},
                              {"seconds", to_json(samples_)},
                              {"sweeps_seconds", work.all_grids},
                              {"fine_sweep_equivalents", equivalents}}},
                            {"fine_sweep_seconds", work.sweep},
                            {"plain_sweeps", plain.sweeps},
                            {"plain_counted_with_steps", plain.steps}});
    lines_.push_back({backend_.name(), fmt::format("{}", size.Q), fmt::format("{}", size.J), to_string(exact.status),
                      fmt::format("{}", exact.cycles), fmt::format("{:.3f}", contraction(exact)),
                      fmt::format("{}", stopped.cycles), scientific(left), scientific(error),
                      fmt::format("{:.1f}", equivalents), format_seconds(median(samples_.setup)),
                      format_seconds(median(samples_.solve)),
                      fmt::format("{}{}", plain.steps == size.J ? "" : "~ ", plain.sweeps)});
  }

  Backend& backend_;
  int repeats_;
  BenchReport& report_;
  Samples samples_;
  std::map<double, PlainSweeps> plain_;
  std::vector<std::vector<std::string>> lines_{{"backend", "Q", "J", "status", "cycles", "contraction", "useful",
                                                "algebraic", "error", "fine sweeps", "set-up", "solve", "plain"}};
};

void refuse_other_scenes(const BenchRequest& request) {
  if (request.scene.value_or("signorini") != "signorini")
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "leave it out: this benchmark uses signorini");
  for (const auto& [key, value] : request.settings)
    if (key != "Q") throw Error("--set", "found '" + key + "'", "set Q, or nothing");
}

// Summary of the rows; cases that miss a goal are named.
std::vector<std::string> multigrid_notes(const Json& rows) {
  double contracts = 0;
  long all = 0, cheap = 0;
  std::string slow, inexact, unknown, flattered;
  for (const Json& row : rows) {
    if (row.contains("skipped")) continue;
    const std::string name = fmt::format(" {} Q={} J={}", row["backend"].get<std::string>(), row["Q"].get<double>(),
                                         row["steps"].get<Index>());
    const Json& useful = row["useful"];
    ++all;
    cheap += useful["fine_sweep_equivalents"] <= wanted_sweeps;
    contracts = std::max(contracts, row["contraction"].get<double>());
    if (!(row["contraction"] <= wanted_contraction) || row["status"] != "solved") slow += name;
    const Json& estimated = useful["algebraic_error_estimated"];
    const double left = useful["algebraic_error"];
    if (!(estimated.is_number() && estimated.get<double>() >= left)) flattered += name;
    const Json& known = useful["discretisation_error"];
    const double error = known.is_number() ? known.get<double>() : NAN;
    if (std::isnan(error))
      unknown += name;
    else if (!(left <= useful_share * error))
      inexact += name;
  }
  const auto missed = [](const std::string& names) { return names.empty() ? "missed nowhere" : "missed at" + names; };
  return {fmt::format("contraction of a cycle: {:.3f} at most; {} {}", contracts, wanted_contraction, missed(slow)),
          fmt::format("at most {} fine-sweep equivalents: {} of {} cases", wanted_sweeps, cheap, all),
          fmt::format("algebraic error: a tenth of the discretisation error {}{}", missed(inexact),
                      unknown.empty() ? "" : "; the latter is not known at" + unknown),
          fmt::format("algebraic error: its estimate {}",
                      flattered.empty() ? "is smaller nowhere" : "is smaller at" + flattered)};
}

}  // namespace

BenchReport bench_multigrid(const BenchRequest& request, Backend& backend) {
  refuse_other_scenes(request);
  BenchReport report;
  report.scene = "signorini";
  report.details["contraction"] = fmt::format(
      "largest quotient of the changes of consecutive cycles, those above {:g}, in a run to 1e-12", least_change);
  report.details["useful"] = fmt::format(
      "the run that stops where its estimate of the algebraic error is below {} of its estimate of the discretisation "
      "error",
      useful_share);
  report.details["algebraic_error"] =
      "largest difference from the run to 1e-12, relative to max(1, |y|) of a time point";
  report.details["discretisation_error"] = "from the differences between the three finest grids (error_estimate)";
  report.details["fine_sweep_equivalents"] =
      "seconds of nested start and cycles on all grids over those of one sweep of the plain iteration, medians";
  report.details["plain_sweeps"] =
      "of the plain iteration to 1e-12; plain_counted_with_steps: the steps with which they were counted";
  std::vector<Grid> chosen = study_sizes(request.quick);
  if (request.settings.contains("Q"))
    for (Grid& size : chosen) size.Q = request.settings.at("Q");
  if (request.steps > 0)
    for (Grid& size : chosen) size.J = request.steps;
  const auto same = [](const Grid& a, const Grid& b) { return a.Q == b.Q && a.J == b.J; };
  chosen.erase(std::unique(chosen.begin(), chosen.end(), same), chosen.end());

  const std::string text = on_each_backend(request, backend, report, [&](Backend& one) {
    Study study(one, std::min(request.repeats(), 3), report);
    for (const Grid& size : chosen) study.run(size);
    return table(study.lines());
  });
  report.notes = multigrid_notes(report.rows);
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
