// Cost of Galerkin over the number of intervals, and the periodic state compared with marching to it.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/galerkin.hpp"
#include "catalogue/catalogue.hpp"
#include "core/base/timer.hpp"
#include "core/galerkin/discretisation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr double wanted_agreement = 1e-6;  ///< of the periodic states
constexpr Index most_periods = 40;
constexpr double most_seconds = 5;  ///< of a solve; the next size is then omitted

std::size_t bytes_of(const GalerkinProblem& p) { return sizeof(double) * std::size_t(p.forcing.size() + p.q.size()); }

/// Seconds of a solve.
double measure_size(const std::string& name, Index J, const BenchRequest& request, Backend& backend,
                    std::vector<std::vector<std::string>>& text, BenchReport& report) {
  const Scene scene = make_scene(name);
  const GalerkinProblem p = galerkin_problem(scene, J);
  const RowMatrix z = RowMatrix::Ones(J, p.unknowns());
  std::vector<double> application, whole;
  double sum = 0;  // prevents the compiler from removing applications
  Options options;
  options.method = Method::galerkin;
  options.steps = J;
  Result r;
  for (int i = 0; i < request.repeats(); ++i) {
    Timer timer;
    sum += apply_galerkin(p, z)(0, 0);
    application.push_back(timer.lap());
    r = solve(scene, backend, options);
    whole.push_back(r.seconds.total);
    if (whole.back() > 2) break;
  }
  report.rows.push_back({{"part", "cost"},
                         {"scene", name},
                         {"steps", J},
                         {"finite", std::isfinite(sum)},
                         {"problem_bytes", bytes_of(p)},
                         {"application_seconds", median(application)},
                         {"status", to_string(r.status)},
                         {"iterations", r.iterations},
                         {"solve_seconds", median(whole)},
                         {"solve_bytes", r.bytes},
                         {"residual", r.residual}});
  text.push_back({name, fmt::format("{}", J), format_seconds(median(application)), format_bytes(double(bytes_of(p))),
                  format_seconds(median(whole)), format_bytes(double(r.bytes)), fmt::format("{}", r.iterations),
                  to_string(r.status)});
  return median(whole);
}

/// Growth of a member from the first to the last row of a scene, as a power of the number of steps.
double power(const BenchReport& report, const std::string& scene, const char* member) {
  const Json *first = nullptr, *last = nullptr;
  for (const Json& row : report.rows)
    if (row["part"] == "cost" && row["scene"] == scene && row["status"] == "solved") {
      if (!first) first = &row;
      last = &row;
    }
  if (!first || first == last) return NAN;
  return std::log((*last)[member].get<double>() / (*first)[member].get<double>()) /
         std::log((*last)["steps"].get<double>() / (*first)["steps"].get<double>());
}

void study_sizes(const BenchRequest& request, Backend& backend, BenchReport& report) {
  std::vector<std::vector<std::string>> text{
      {"scene", "steps", "application", "problem", "solve", "memory", "exchanges", "status"}};
  const int last = request.quick ? 11 : 17;
  for (const char* name : {"bridge", "lq-control", "nash-game", "periodic-rectifier"}) {
    double took = 0;
    int k = 10;
    for (; k <= last && took < most_seconds; ++k)
      took = measure_size(name, Index(1) << k, request, backend, text, report);
    const double growth = power(report, name, "application_seconds");
    if (std::isnan(growth)) continue;
    report.notes.push_back(fmt::format(
        "{}: from 2^10 to 2^{} intervals an application grows as N^{:.2f}, a solve as N^{:.2f}, its memory as N^{:.2f}",
        name, k - 1, growth, power(report, name, "solve_seconds"), power(report, name, "solve_bytes")));
  }
  print("cost\n" + table(text) + "\n");
}

/// Marches from v = 0 over whole periods until v at their ends changes by less than a tenth of the wanted agreement.
struct LongRun {
  Index periods = 0;
  double seconds = NAN;  ///< of the march over these periods
  RowMatrix last;        ///< v over the last of them, J+1 rows
};

LongRun march_to_the_limit(Scene scene, Index J, const BenchRequest& request, Backend& backend) {
  LongRun run;
  const double period = scene.T;
  scene.boundary.reset();
  scene.x0 = Vector::Zero(1);
  const auto march = [&](Index periods) {
    scene.T = double(periods) * period;
    Options options;
    options.method = Method::march;
    options.steps = periods * J;
    options.states = StateSelection::all;
    return solve(scene, backend, options);
  };
  const Result far = march(most_periods);
  if (far.status != Status::solved) return run;
  for (run.periods = 1; run.periods < most_periods; ++run.periods)
    if (std::abs(far.x(run.periods * J, 0) - far.x((run.periods - 1) * J, 0)) < 0.1 * wanted_agreement) break;
  std::vector<double> seconds;
  for (int i = 0; i < request.repeats(); ++i) {
    const Result result = march(run.periods);
    seconds.push_back(result.seconds.total);
    run.last = result.x.bottomRows(J + 1);
  }
  run.seconds = median(seconds);
  return run;
}

void study_periodic(const BenchRequest& request, Backend& backend, BenchReport& report) {
  std::vector<std::vector<std::string>> text{
      {"steps", "galerkin", "exchanges", "march", "periods", "difference of v", "times as long"}};
  const Scene scene = make_scene("periodic-rectifier");
  Options options;
  options.method = Method::galerkin;
  options.states = StateSelection::all;
  for (const Index J : request.quick ? std::vector<Index>{400, 6400} : std::vector<Index>{400, 1600, 6400, 25600}) {
    options.steps = J;
    Result r;
    std::vector<double> seconds;
    for (int i = 0; i < request.repeats(); ++i) {
      r = solve(scene, backend, options);
      seconds.push_back(r.seconds.total);
    }
    const LongRun run = march_to_the_limit(scene, J, request, backend);
    const bool both = r.status == Status::solved && run.last.rows() == J + 1;
    const double difference = both ? (r.x - run.last).cwiseAbs().maxCoeff() : NAN;
    const double times = run.seconds / median(seconds);
    report.rows.push_back({{"part", "periodic"},
                           {"scene", scene.name},
                           {"steps", J},
                           {"status", to_string(r.status)},
                           {"iterations", r.iterations},
                           {"boundary_residual", r.boundary_residual.value_or(NAN)},
                           {"seconds", median(seconds)},
                           {"march_periods", run.periods},
                           {"march_seconds", run.seconds},
                           {"difference", difference}});
    text.push_back({fmt::format("{}", J), format_seconds(median(seconds)), fmt::format("{}", r.iterations),
                    format_seconds(run.seconds), fmt::format("{}", run.periods), scientific(difference),
                    fmt::format("{:.1f}", times)});
    report.notes.push_back(
        fmt::format("periodic-rectifier, {} steps a period: v differs from the limit of marching by {:.1e}; marching "
                    "{} periods takes {:.1f} times as long",
                    J, difference, run.periods, times));
  }
  print("periodic-rectifier\n" + table(text) + "\n");
}

}  // namespace

void study_galerkin_cost(const BenchRequest& request, Backend& backend, BenchReport& report) {
  study_sizes(request, backend, report);
  study_periodic(request, backend, report);
}

}  // namespace bromwich::app
