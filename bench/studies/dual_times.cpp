// Times at equal errors of w: cycles in w on a backend, marching on one core.

#include "app/text.hpp"
#include "bench/studies/dual.hpp"
#include "core/base/timer.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

namespace bromwich::app {

namespace {

// Times at equal error of w: steps are doubled until w is within `wanted_dual_error` of a reference.
class EqualError {
 public:
  EqualError(Backend& backend, const DualReach& reach, double Q, Index reference_steps, BenchReport& report)
      : backend_(backend),
        longest_run_(reach.longest_run),
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
    Json ladder = Json::array();
    for (Index J = first_steps; J <= most_; J *= 2) {
      options.steps = J;
      options.trace = true;
      Solver solver(scene_, backend, options);
      const Result first = solver.solve();
      const double error =
          first.status == Status::solved ? difference_of_grids(reference_, gap_of(scene_, first)) : NAN;
      ladder.push_back({{"steps", J}, {"error_w", error}, {"seconds", first.seconds.total}});
      if (!(error <= wanted_dual_error) && J < most_ && 2 * first.seconds.total < longest_run_) continue;
      Samples whole, prepared;
      const bool long_one = first.seconds.total > 0.1 * longest_run_;
      if (long_one) whole.add(first.seconds.total, first.seconds.setup, first.seconds.solve);
      for (int k = 0; k < (long_one ? 1 : repeats_at_equal_error); ++k) {
        Options plain = options;
        plain.trace = false;
        const Result once = long_one ? first : solve(scene_, backend, plain);
        if (!long_one) whole.add(once.seconds.total, once.seconds.setup, once.seconds.solve);
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
                              {"wanted", wanted_dual_error},
                              {"ladder", ladder},
                              {"status", to_string(first.status)},
                              {"first_seconds", first.seconds.total},
                              {"whole", to_json(whole)},
                              {"prepared", to_json(prepared)}});
      return;
    }
  }

  const std::vector<std::vector<std::string>>& lines() const { return lines_; }

 private:
  static constexpr Index first_steps = 32;
  static constexpr int repeats_at_equal_error = 3;

  Backend& backend_;
  double longest_run_;
  std::unique_ptr<Backend> one_;
  Scene scene_;
  double Q_;
  BenchReport& report_;
  Index most_;
  RowMatrix reference_;
  std::vector<std::vector<std::string>> lines_{
      {"backend", "method", "Q", "J", "error of w", "status", "whole", "prepared"}};
};

}  // namespace

DualReach dual_reach(const Backend& backend, bool quick) {
  if (quick) return {10, 6e5, 1e6, 1e6, 1};
  if (backend.name() == "cpu") return {150, 6e5, 2.4e6, 2e7, 10};
  return {190, 1.7e7, 6.8e7, 0, 30};
}

Options dual_options(Method method, Index J, bool by_euler) {
  Options options;
  options.method = method;
  options.steps = J;
  options.tuning.dual_by_euler = by_euler;
  return options;
}

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

double difference_of_grids(const RowMatrix& a, const RowMatrix& b) {
  const Index steps = std::min(a.rows(), b.rows()) - 1, A = (a.rows() - 1) / steps, B = (b.rows() - 1) / steps;
  double largest = 0;
  for (Index j = 1; j <= steps; ++j) largest = std::max(largest, (a.row(A * j) - b.row(B * j)).cwiseAbs().maxCoeff());
  return largest;
}

std::vector<std::string> notes_on_dual_times(const Json& rows) {
  struct Times {
    double whole = INFINITY, prepared = INFINITY, error = NAN;
  };
  std::map<std::pair<std::string, double>, std::map<std::string, Times>> groups;
  std::string of;
  for (const Json& row : rows) {
    if (!row.contains("equal_error") || !std::isfinite(row["whole"]["median"].get<double>())) continue;
    const std::string method = row["method"];
    if (method == "dual") of = row["backend"];  // the methods on one core follow
    Times& times = groups[{of, row["Q"].get<double>()}][method.substr(0, 4) == "dual" ? "dual" : method];
    const double whole = row["whole"]["median"];
    if (whole < times.whole) times = {whole, row["prepared"]["median"], row["error_w"]};
  }
  std::vector<std::string> notes;
  for (const auto& [key, found] : groups)
    for (const auto& [method, times] : found) {
      if (method == "dual" || !found.contains("dual")) continue;
      const Times& dual = found.at("dual");
      notes.push_back(fmt::format(
          "Q = {} on {}: {} on one core / dual: {}{:.3g} whole, {:.3g} prepared, {:.3g} one solve of "
          "it / dual prepared (error of w {:.1e} and {:.1e})",
          key.second, key.first, method, times.error <= wanted_dual_error ? "" : "at least ", times.whole / dual.whole,
          times.prepared / dual.prepared, times.whole / dual.prepared, times.error, dual.error));
    }
  return notes;
}

std::string compare_dual_times(Backend& backend, double Q, bool quick, BenchReport& report) {
  const DualReach reach = dual_reach(backend, quick);
  const Index reference_steps = quick ? 1024 : 16384;
  if (Q * double(reference_steps) > reach.most_referred) return "";
  EqualError times(backend, reach, Q, reference_steps, report);
  Options cycles = dual_options(Method::dual, 0);
  cycles.iteration_tolerance = 0.01 * wanted_dual_error;
  times.run("dual", true, cycles);
  cycles.tuning.dual_by_euler = true;
  times.run("dual by euler", true, cycles);
  times.run("march", false, dual_options(Method::march, 0));
  times.run("euler", false, dual_options(Method::euler, 0));
  return table(times.lines());
}

}  // namespace bromwich::app
