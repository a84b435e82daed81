// Cycles in w on contact: contraction of the cycles, cycles until the algebraic errors of w and of y are below a tenth
// of the discretisation error, plain sweeps beside them, and times compared with marching on one core (dual_times.cpp).

#include "bench/studies/dual.hpp"
#include "app/text.hpp"
#include "bench/studies/dual_puts.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/multigrid/dual_levels.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

namespace bromwich::app {

namespace {

constexpr double wanted_contraction = 0.2;  ///< where c h/dx^2 is at least `crossed`
constexpr double crossed = 0.05;            ///< diffusion crosses a cell in a step
constexpr double least_change = 1e-10;      ///< smaller changes are not used for the contraction
constexpr double algebraic_part = 0.1;      ///< of the discretisation error, in the useful runs
constexpr Index most_plain_sweeps = 400;
constexpr Index wanted_sweeps = 20;  ///< in which both algebraic errors are to be below their parts

struct ContactGrid {
  double Q;
  Index J;
  double c, eps;
  double mu(double T) const { return c * T / double(J) * (Q + 1) * (Q + 1); }
};

// By size, so that what does not fit into the time is what is largest.
std::vector<ContactGrid> contact_grids(bool quick) {
  if (quick) return {{15, 64, 0.05, 0}, {31, 256, 0.05, 1e-2}};
  std::vector<ContactGrid> all;
  for (const Index J : {256, 1024, 4096, 16384})
    for (const double Q : {15., 63., 255., 511., 1023.})
      for (const double c : {0.002, 0.05, 1.})
        for (const double eps : {0., 1e-2, 1e-1})
          if (eps == 0 || (c == 0.05 && (eps < 0.05 || Q == 511))) all.push_back({Q, J, c, eps});
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.Q * a.J < b.Q * b.J; });
  return all;
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
  DualStudy(Backend& backend, const DualReach& reach, bool by_euler, int repeats, BenchReport& report)
      : backend_(backend),
        reach_(reach),
        by_euler_(by_euler),
        one_(make_cpu_backend(1)),
        repeats_(repeats),
        report_(report) {}

  void run(const ContactGrid& grid) {
    if (grid.Q * double(grid.J) > reach_.most_values) return;
    elapsed_ += spent_.lap();
    if (elapsed_ > reach_.seconds) return skip(grid, "no time left");
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
      if (double(grid.J) * grid.Q * grid.Q <= reach_.most_marched) march(scene, grid, cycles, row);
      lines_.push_back({backend_.name(), by_euler_ ? "euler" : "radau", fmt::format("{}", grid.Q),
                        fmt::format("{}", grid.J), fmt::format("{}", grid.c), fmt::format("{}", grid.eps),
                        to_string(cycles.status), fmt::format("{}", cycles.cycles), fmt::format("{:.3f}", found.mean),
                        fmt::format("{:.3f}", found.largest), format_seconds(median(samples.setup)),
                        format_seconds(median(samples.solve))});
      report_.rows.push_back(std::move(row));
    } catch (const Error& error) {
      skip(grid, error.what());
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
    for (int k = 0; k <= repeats_; ++k) {  // the first one warms up, and is the only one if it takes long
      result = solve(scene, backend, options);
      const bool only = repeats_ == 0 || result.seconds.total > 0.5;
      if (k > 0 || only) samples.add(result.seconds.total, result.seconds.setup, result.seconds.solve);
      if (only) break;
    }
    return result;
  }

  void skip(const ContactGrid& grid, const std::string& why) const {
    report_.rows.push_back({{"backend", backend_.name()},
                            {"rule", by_euler_ ? "euler" : "radau"},
                            {"Q", grid.Q},
                            {"steps", grid.J},
                            {"c", grid.c},
                            {"eps", grid.eps},
                            {"skipped", why}});
  }

  // Cycles that end where further ones are of no use: their sweeps, the true algebraic errors of y and w, and the
  // discretisation errors of both against the stages of Radau IIA on steps of a quarter.
  void stop_early(const Scene& scene, const ContactGrid& grid, const Result& cycles, Json& row) const {
    Options options = dual_options(Method::dual, grid.J, by_euler_);
    options.trace = true;
    options.tuning.algebraic_share = algebraic_part;
    const Result early = solve(scene, backend_, options);
    if (early.status != Status::solved || cycles.trace.rows() != cycles.y.rows()) return;
    const RowMatrix w = gap_of(scene, cycles);
    Json& useful = row["useful"];
    const double of_w = difference_of_grids(gap_of(scene, early), w);
    useful = {{"cycles", early.cycles},
              {"sweeps", early.iterations},
              {"algebraic_error_estimated", early.algebraic_error.value_or(NAN)},
              {"algebraic_error_y", difference_of_grids(early.y, cycles.y)},
              {"algebraic_error_w", of_w}};
    useful["plain_sweeps"] = plain_sweeps(scene, grid, cycles.form == "dual" && !cycles.continuous ? 2 : 1, w, of_w);
    if (4 * double(grid.J) * grid.Q > reach_.most_referred) return;
    Options finer = dual_options(Method::dual, 4 * grid.J);
    finer.trace = true;
    const Result reference = solve(scene, backend_, finer);
    if (reference.status != Status::solved) return;
    useful["error_y"] = difference_of_grids(reference.y, cycles.y);
    useful["error_w"] = difference_of_grids(gap_of(scene, reference), w);
    useful["error_integral_of_y"] = difference_of_grids(integral_of_y(reference), integral_of_y(cycles));
    useful["algebraic_error_integral_of_y"] = difference_of_grids(integral_of_y(early), integral_of_y(cycles));
    row["needed"] = needed_sweeps(scene, grid, cycles, w, useful);
  }

  // Cycles until the true algebraic errors of w and of y are below their parts of the true discretisation errors; null:
  // not within `wanted_sweeps`.
  Json needed_sweeps(const Scene& scene, const ContactGrid& grid, const Result& cycles, const RowMatrix& w,
                     const Json& errors) const {
    Options options = dual_options(Method::dual, grid.J, by_euler_);
    options.trace = true;
    constexpr Index sweeps_a_cycle = 4;
    for (Index sweeps = sweeps_a_cycle; sweeps <= wanted_sweeps; sweeps += sweeps_a_cycle) {
      options.max_iterations = sweeps;
      const Result few = solve(scene, backend_, options);
      if (few.trace.rows() != w.rows()) return nullptr;
      const double of_w = difference_of_grids(gap_of(scene, few), w), of_y = difference_of_grids(few.y, cycles.y);
      if (of_w <= algebraic_part * errors["error_w"].get<double>() &&
          of_y <= algebraic_part * errors["error_y"].get<double>())
        return {{"sweeps", few.iterations}, {"algebraic_error_w", of_w}, {"algebraic_error_y", of_y}};
    }
    return nullptr;
  }

  // Sweeps on the finest grid alone until w is as near to the discrete solution as by the cycles; null: not by
  // `most_plain_sweeps`.
  Json plain_sweeps(const Scene& scene, const ContactGrid& grid, Index stages, const RowMatrix& w,
                    double wanted) const {
    const DiscreteProblem p = discretise(scene, backend_, grid.J);
    const auto op = make_time_operator(p);
    const auto dual = dual_levels(*op, stages, dual_options(Method::dual, grid.J, by_euler_));
    if (dual->levels.size() < 2) return nullptr;
    TimeLevel& finest = dual->levels[0];
    RowMatrix values = RowMatrix::Zero(finest.y->rows(), finest.y->cols());
    values.row(0) = w.row(0);
    backend_.upload(values, *finest.y);
    for (Index count = 1; count <= most_plain_sweeps; ++count) {
      finest.kernel->apply(*finest.y, *finest.v, 0);
      finest.lcp->submit(*finest.r, *finest.v, *finest.y, 1, -1);
      if (count % (count < 10 * sweeps_between_looks ? sweeps_between_looks : 5 * sweeps_between_looks) != 0) continue;
      finest.lcp->collect();
      backend_.download(*finest.y, values);
      const RowMatrix ends = values(Eigen::seq(0, values.rows() - 1, stages), Eigen::all);
      if (difference_of_grids(ends, w) <= wanted) return count;
    }
    return nullptr;
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

  static constexpr Index sweeps_between_looks = 4;

  Backend& backend_;
  DualReach reach_;
  bool by_euler_;
  std::unique_ptr<Backend> one_;
  int repeats_;
  BenchReport& report_;
  Timer spent_;
  double elapsed_ = 0;
  std::vector<std::vector<std::string>> lines_{
      {"backend", "rule", "Q", "J", "c", "eps", "status", "cycles", "mean", "largest", "set-up", "solve"}};
};

// In how many runs the algebraic errors of y and w are below their parts within the sweeps wanted.
std::string sweeps_and_errors(const Json& rows) {
  int runs = 0, good = 0;
  std::string missed;
  for (const Json& row : rows) {
    if (!row.contains("needed")) continue;
    ++runs;
    if (!row["needed"].is_null())
      ++good;
    else
      missed += fmt::format(" {} {} Q={} J={} c={} eps={}", row["backend"].get<std::string>(),
                            row["rule"].get<std::string>(), row["Q"].get<double>(), row["steps"].get<Index>(),
                            row["c"].get<double>(), row["eps"].get<double>());
  }
  return fmt::format(
      "algebraic errors of w and of y below {} of their discretisation errors within {} fine sweeps in {} "
      "of {} runs{}",
      algebraic_part, wanted_sweeps, good, runs, missed.empty() ? "" : "; not at" + missed);
}

// In how many runs the stop by estimates leaves both true algebraic errors below their parts.
std::string estimates_kept(const Json& rows) {
  int runs = 0, good = 0;
  double worst = 0;
  for (const Json& row : rows) {
    if (!row.contains("useful") || !row["useful"].contains("error_w")) continue;
    const Json& useful = row["useful"];
    double largest = 0;
    for (const char* of : {"w", "y"}) {
      const std::string name = of;
      largest =
          std::max(largest, useful["algebraic_error_" + name].get<double>() / useful["error_" + name].get<double>());
    }
    ++runs;
    if (largest <= algebraic_part) ++good;
    worst = std::max(worst, largest);
  }
  return fmt::format(
      "cycles that end by estimates: both algebraic errors below {} of their discretisation errors in {} of {} runs, "
      "{:.2g} of them at most",
      algebraic_part, good, runs, worst);
}

std::vector<std::string> dual_notes(const Json& rows) {
  std::string slow, ended;
  double largest = 0;
  for (const Json& row : rows) {
    if (row.contains("skipped") || row.contains("equal_error") || row.contains("put")) continue;
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
  const auto cost = sweeps_and_errors(rows);
  return {fmt::format("contraction of a cycle where c h/dx^2 >= {}: {:.3f} at most; {} missed {}", crossed, largest,
                      wanted_contraction, missed(slow)),
          fmt::format("not solved {}", missed(ended)), cost, estimates_kept(rows)};
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
  report.details["useful"] =
      "cycles that stop where the estimate of the algebraic error is below 0.1 of that of the discretisation error; "
      "algebraic errors against the solved cycles, discretisation errors against Radau IIA on steps of a quarter";
  report.details["needed"] =
      "cycles until the algebraic errors of w and of y are both below 0.1 of their discretisation errors; null: more "
      "than "
      "20 fine sweeps";
  report.details["equal_error"] =
      "steps are doubled until the error of w is below `wanted`; ladder: the first solves on the way, set-up and start "
      "of "
      "the backend included; whole and prepared: medians with these steps";
  report.details["plain_sweeps"] =
      "on the finest grid alone, to the algebraic error of w of the useful cycles; null: above 400";
  report.details["march"] = "Radau IIA on one core with as many steps";
  std::vector<ContactGrid> chosen = contact_grids(request.quick);
  for (ContactGrid& grid : chosen) {
    if (request.settings.contains("Q")) grid.Q = request.settings.at("Q");
    if (request.settings.contains("c")) grid.c = request.settings.at("c");
    if (request.settings.contains("eps")) grid.eps = request.settings.at("eps");
    if (request.steps > 0) grid.J = request.steps;
  }
  std::vector<ContactGrid> different;
  for (const ContactGrid& grid : chosen) {
    const auto same = [&](const ContactGrid& a) {
      return a.Q == grid.Q && a.J == grid.J && a.c == grid.c && a.eps == grid.eps;
    };
    if (std::none_of(different.begin(), different.end(), same)) different.push_back(grid);
  }
  const bool with_puts = request.settings.empty() && request.steps == 0;
  const std::string text = on_each_backend(request, backend, report, [&](Backend& one) {
    const bool host = one.name() == "cpu";
    std::string tables;
    for (const bool by_euler : {false, true}) {
      DualStudy study(one, dual_reach(one, request.quick), by_euler, std::min(request.repeats(), 3), report);
      for (const ContactGrid& grid : different) study.run(grid);
      tables += table(study.lines());
    }
    const double Q = request.settings.contains("Q") ? request.settings.at("Q") : request.quick ? 15 : host ? 127 : 511;
    tables += compare_dual_times(one, Q, request.quick, report);
    return host && with_puts ? tables + table(measure_puts(request.quick, report)) : tables;
  });
  report.notes = dual_notes(report.rows);
  for (std::string& note : notes_on_dual_times(report.rows)) report.notes.push_back(std::move(note));
  if (request.backend != "cuda" && with_puts) report.notes.push_back(note_on_puts(report.rows));
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
