// Hard cases with known solutions, solved to a tolerance by `auto`, and by implicit Euler, ours and that of Siconos,
// with the same number of steps: true error, estimated error, status and time.
//
// The error of component i is relative to max(max_t |c_i|, 1e-3 of the largest component of its kind). If y jumps, the
// error of its integral from 0 to t is used.

#include "bench/studies/stability.hpp"

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/siconos.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <map>

namespace bromwich::app {

namespace {

constexpr double most_seconds = 30;   ///< of one solve; then it is interrupted
constexpr double short_solve = 0.25;  ///< longer ones are not repeated
constexpr Index most_euler_steps = 20000;

struct Found {
  std::string status, reason, warning, method;
  Index steps = 0;
  double error_x = NAN, error_y = NAN, estimate = NAN;
  bool of_integral = false;
  Samples samples;

  double error() const { return std::fmax(error_x, error_y); }
};

using Clock = std::chrono::steady_clock;

Result timed_solve(const HardCase& one, Backend& backend, Options options) {
  const auto start = Clock::now();
  options.interrupted = [start] { return std::chrono::duration<double>(Clock::now() - start).count() > most_seconds; };
  options.states = one.components.empty() ? StateSelection::all : StateSelection::list;
  options.components = one.components;
  return solve(one.scene, backend, options);
}

/// The exact solution at the rows of a result; `integral` of y by midpoints, with the impulse: at least 16 per
/// step and 131072 in all, for contacts shorter than a step.
struct Truth {
  RowMatrix x, y, integral;
};

Truth truth(const HardCase& one, const Result& r, bool integrate) {
  const Index J = r.t.size() - 1, m = one.scene.states(), n = one.scene.constraints();
  Truth out{RowMatrix(J + 1, r.x.cols()), RowMatrix(J + 1, n), RowMatrix::Zero(J + 1, n)};
  Vector x(m), y(n);
  const int points = int(std::max<Index>(16, (Index(1) << 17) / std::max<Index>(1, J)));
  if (one.impulse.size() > 0) out.integral.row(0) = one.impulse.transpose();
  for (Index j = 0; j <= J; ++j) {
    one.scene.exact(r.t[j], x, y);
    out.x.row(j) = x(r.x_components).transpose();
    out.y.row(j) = y.transpose();
    if (!integrate || j == 0) continue;
    const double h = (r.t[j] - r.t[j - 1]) / points;
    out.integral.row(j) = out.integral.row(j - 1);
    for (int k = 0; k < points; ++k) {
      one.scene.exact(r.t[j - 1] + (k + 0.5) * h, x, y);
      out.integral.row(j) += h * y.transpose();
    }
  }
  return out;
}

/// Error over rows 1 to `last`, each column relative to the measure above.
double error_in_measure(const RowMatrix& found, const RowMatrix& exact, Index last) {
  const Vector sizes = exact.topRows(last + 1).cwiseAbs().colwise().maxCoeff().transpose();
  if (sizes.size() == 0) return 0;
  double worst = 0;
  for (Index i = 0; i < found.cols(); ++i) {
    const double size = std::max(sizes[i], 1e-3 * sizes.maxCoeff());
    const double off = (found.col(i) - exact.col(i)).segment(1, last).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
    worst = std::max(worst, std::isnan(off) ? INFINITY : size > 0 ? off / size : off);
  }
  return worst;
}

void compare(const HardCase& one, const Result& r, Found& found) {
  const Index J = r.y.rows() - 1;
  if (J < 1 || r.x.rows() != J + 1) return;
  Index last = 0;
  while (last < J && r.t[last + 1] <= one.until) ++last;
  found.of_integral = r.errors ? r.errors->of_integral : one.y_jumps;  // what the estimate is of
  const Truth exact = truth(one, r, found.of_integral && one.compare_y);
  found.error_x = error_in_measure(r.x, exact.x, last);
  if (!one.compare_y) return;
  found.error_y = found.of_integral ? error_in_measure(integral_of_y(r), exact.integral, last)
                                    : error_in_measure(r.y, exact.y, last);
}

using SolveOnce = std::function<Result()>;

Found run(const HardCase& one, const SolveOnce& solve_once, int repeats) {
  Found found;
  try {
    for (int i = 0; i < repeats; ++i) {
      const Result r = solve_once();
      found.samples.add(r.seconds.total, r.seconds.setup, r.seconds.solve);
      if (i > 0) continue;
      found.status = to_string(r.status);
      found.reason = r.reason;
      found.warning = r.warning;
      found.method = to_string(r.method);
      found.steps = r.steps;
      found.estimate = r.error_estimate.value_or(NAN);
      if (found.status == one.expected || r.status == Status::solved) compare(one, r, found);
      if (!(r.seconds.total <= short_solve)) break;  // NaN: Siconos did not end
    }
  } catch (const Error& error) {
    found.status = "error";
    found.reason = error.what();
  }
  return found;
}

std::string verdict(const HardCase& one, const Found& found) {
  if (found.status != one.expected) return found.status == "solved" ? "wrong" : "refused";
  return found.error() <= one.tolerance ? "right" : found.error() <= 3 * one.tolerance ? "missed" : "wrong";
}

Json json_of(const Found& f) {
  return {{"status", f.status},           {"reason", f.reason},     {"warning", f.warning},
          {"method", f.method},           {"steps", f.steps},       {"error_x", f.error_x},
          {"error_y", f.error_y},         {"estimate", f.estimate}, {"of", f.of_integral ? "integral of y" : "y"},
          {"seconds", to_json(f.samples)}};
}

std::vector<HardCase> chosen(const BenchRequest& request) {
  std::vector<HardCase> list = hard_cases(request.quick);
  if (!request.scene) return list;
  std::erase_if(list, [&](const HardCase& one) { return one.group != *request.scene; });
  if (list.empty())
    throw Error("SCENE", fmt::format("found '{}'", *request.scene), "use A, M, sources, starts, scales or sizes");
  return list;
}

}  // namespace

BenchReport bench_stability(const BenchRequest& request, Backend& backend) {
  BenchReport report;
  report.scene = request.scene.value_or("all");
  report.details["error"] =
      "largest over the time points t > 0, component i relative to max(max_t |c_i|, 1e-3 of the largest component of "
      "its "
      "kind); of the integral of y from 0 to t where y jumps";
  report.details["verdict"] = "right: error <= tolerance; missed: <= 3 of it; wrong: above; refused: another status";
  std::vector<std::vector<std::string>> text{{"case", "m", "n", "verdict", "status", "method", "steps", "error x",
                                              "error y", "estimate", "time", "Euler x", "Euler y", "time"}};
  std::map<std::string, Index> counts;
  for (const HardCase& one : chosen(request)) {
    Options options;
    options.tolerance = one.tolerance;
    const Found found = run(
        one, [&] { return timed_solve(one, backend, options); }, request.repeats());
    Options plain;
    plain.method = Method::euler;
    plain.steps = std::min(most_euler_steps, found.steps > 0 ? found.steps : one.scene.steps());
    const Found euler = run(
        one, [&] { return timed_solve(one, backend, plain); }, request.repeats());
    const std::string judged = verdict(one, found);
    ++counts[judged];
    const Index m = one.scene.states(), n = one.scene.constraints();
    text.push_back({one.group + ": " + one.name, fmt::format("{}", m), fmt::format("{}", n), judged, found.status,
                    found.method, fmt::format("{}", found.steps), scientific(found.error_x), scientific(found.error_y),
                    scientific(found.estimate), format_seconds(median(found.samples.total)), scientific(euler.error_x),
                    scientific(euler.error_y), format_seconds(median(euler.samples.total))});
    Json row{{"group", one.group},       {"case", one.name},           {"states", m},
             {"constraints", n},         {"reference", one.reference}, {"tolerance", one.tolerance},
             {"expected", one.expected}, {"verdict", judged}};
    row.update(json_of(found));
    row["euler"] = json_of(euler);
    if (!request.siconos.empty() && fits_siconos(one.scene))
      row["siconos"] = json_of(run(
          one, [&] { return siconos_euler(request.siconos, one.scene, one.components, plain.steps); },
          request.repeats()));
    report.rows.push_back(row);
    if (judged == "wrong" || judged == "refused")
      report.notes.push_back(
          fmt::format("{}: {}{}{}", one.name, judged, found.reason.empty() ? "" : ", ", found.reason));
  }
  for (const auto& [name, count] : counts) report.details["counts"][name] = count;
  print_with_notes(table(text) + "\n", report);
  return report;
}

}  // namespace bromwich::app
