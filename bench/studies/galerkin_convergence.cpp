// Errors of Galerkin and implicit Euler over steps and time, for scenes with known exact solutions.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/boundary_euler.hpp"
#include "bench/studies/galerkin.hpp"
#include "catalogue/catalogue.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace bromwich::app {

namespace {

constexpr double no_order_below = 1e-11;  ///< smaller errors are not used for an order
constexpr double long_solve_seconds = 2;  ///< seconds; a longer solve is not repeated

struct TimeLadder {
  std::string scene, grid;
  std::vector<Index> steps;
};

/// Kinks of the exact solutions: bridge T/6, T/2, 2T/3; nash-game 0.3 and 0.5; lq-control (1 ∓ sqrt 0.6)/2, on no grid.
std::vector<TimeLadder> ladders(bool quick) {
  const auto doubled = [quick](Index first, int full, int few) {
    std::vector<Index> steps;
    for (int k = 0; k < (quick ? few : full); ++k) steps.push_back(first << k);
    return steps;
  };
  std::vector<TimeLadder> list{{"bridge", "kinks on nodes", doubled(24, 10, 4)},
                               {"bridge", "kinks off nodes", doubled(25, 10, 4)},
                               {"nash-game", "kinks on nodes", doubled(10, 6, 2)},
                               {"nash-game", "kinks off nodes", {}},
                               {"lq-control", "kinks off nodes", doubled(16, 9, 3)}};
  for (int k = 3; k < (quick ? 6 : 13); ++k) list[3].steps.push_back((Index(1) << k) - 1);
  return list;
}

struct Measurement {
  bool solved = false;
  std::string reason;
  TimeErrors errors;
  Index iterations = 0;
  double residual = NAN;
  std::vector<double> seconds;
  RowMatrix left, right, x;  ///< y at the ends of the intervals, states
};

/// Repeats as requested, unless one solve takes long.
template <typename Solve>
void repeat(const BenchRequest& request, Measurement& m, const Solve& solve_once) {
  for (int i = 0; i < request.repeats(); ++i) {
    m.seconds.push_back(solve_once());
    if (m.seconds.back() > long_solve_seconds || !m.solved) return;
  }
}

Measurement by_galerkin(const Scene& scene, Backend& backend, Index steps, const BenchRequest& request) {
  Measurement m;
  Options options;
  options.method = Method::galerkin;
  options.steps = steps;
  options.states = StateSelection::all;
  repeat(request, m, [&] {
    Result r = solve(scene, backend, options);
    m.solved = r.status == Status::solved;
    m.reason = r.reason;
    m.iterations = r.iterations;
    m.residual = r.residual;
    m.left = std::move(r.y_left);
    m.right = r.y.bottomRows(steps);
    m.x = std::move(r.x);
    return r.seconds.total;
  });
  if (m.solved) m.errors = galerkin_errors(scene, m.left, m.right, m.x);
  return m;
}

Measurement by_euler(const Scene& scene, Backend& backend, Index steps, const BenchRequest& request) {
  Measurement m;
  repeat(request, m, [&] {
    if (scene.boundary) {
      BoundaryEuler r = solve_by_boundary_euler(scene, backend, steps);
      m.solved = r.solved;
      m.reason = r.reason;
      m.iterations = r.iterations;
      m.residual = r.residual;
      m.right = std::move(r.y);
      m.x = std::move(r.x);
      return r.seconds;
    }
    Options options;
    options.method = Method::euler;
    options.steps = steps;
    options.states = StateSelection::all;
    Result r = solve(scene, backend, options);
    m.solved = r.status == Status::solved;
    m.reason = r.reason;
    m.residual = r.residual;
    m.right = r.y.bottomRows(steps);
    m.x = std::move(r.x);
    return r.seconds.total;
  });
  m.left = m.right;
  if (m.solved) m.errors = euler_errors(scene, m.right, m.x);
  return m;
}

struct Point {
  Index steps;
  TimeErrors errors;
};

constexpr std::array<std::pair<const char*, double TimeErrors::*>, 4> norms{{{"y_L2", &TimeErrors::y_L2},
                                                                             {"x_L2", &TimeErrors::x_L2},
                                                                             {"y_at_T", &TimeErrors::y_at_T},
                                                                             {"x_at_T", &TimeErrors::x_at_T}}};

/// Slope of log error over log steps by least squares, without errors at rounding level; NaN for fewer than two.
double observed_order(const std::vector<Point>& points, double TimeErrors::*norm) {
  double count = 0, sum_h = 0, sum_e = 0, sum_hh = 0, sum_he = 0;
  for (const Point& p : points) {
    if (!(p.errors.*norm > no_order_below)) continue;
    const double h = -std::log(double(p.steps)), e = std::log(p.errors.*norm);
    count += 1;
    sum_h += h;
    sum_e += e;
    sum_hh += h * h;
    sum_he += h * e;
  }
  return count < 2 ? NAN : (count * sum_he - sum_h * sum_e) / (count * sum_hh - sum_h * sum_h);
}

Json convergence_row(const TimeLadder& ladder, const char* method, const Scene& scene, Index steps,
                     const Measurement& m) {
  return {{"part", "convergence"},      {"scene", ladder.scene},  {"grid", ladder.grid},
          {"method", method},           {"steps", steps},         {"h", scene.T / double(steps)},
          {"solved", m.solved},         {"reason", m.reason},     {"error", to_json(m.errors)},
          {"iterations", m.iterations}, {"residual", m.residual}, {"seconds", median(m.seconds)}};
}

// v = -p2 - y_0 + y_1 is linear on every interval, p2 is linear on [0, 1]: cost and switches follow without error.
Json control_row(const char* method, Index steps, double T, const Measurement& m) {
  const double h = T / double(steps), k = 5 / std::sqrt(0.6), a = (1 - std::sqrt(0.6)) / 2;
  double cost = 0;
  for (Index j = 0; j < steps; ++j) {
    const double from = -m.x(j, 3) - m.left(j, 0) + m.left(j, 1), to = -m.x(j + 1, 3) - m.right(j, 0) + m.right(j, 1);
    cost += h / 6 * (from * from + from * to + to * to);
  }
  // Where |p2| crosses the bound.
  const auto crossing = [&](double bound) {
    for (Index j = 0; j < steps; ++j) {
      const double from = -m.x(j, 3) - bound, to = -m.x(j + 1, 3) - bound;
      if (from >= 0 && to <= 0) return h * (double(j) + from / (from - to));
    }
    return double(NAN);
  };
  const double first = crossing(5), second = crossing(-5);
  const double exact = 0.5 * (2 * 25 * a + k * k * std::pow(1 - 2 * a, 3) / 3);
  return {{"part", "control"},
          {"method", method},
          {"steps", steps},
          {"cost", cost},
          {"cost_error", std::abs(cost - exact)},
          {"switches", {first, second}},
          {"switch_error", std::max(std::abs(first - a), std::abs(second - (1 - a)))},
          {"seconds", median(m.seconds)}};
}

void climb(const TimeLadder& ladder, const BenchRequest& request, Backend& backend, BenchReport& report) {
  const Scene scene = make_scene(ladder.scene);
  std::vector<std::vector<std::string>> text{
      {"method", "steps", "y in L2", "x in L2", "y(T)", "x(T)", "exchanges", "time", "status"}};
  std::vector<Point> galerkin, euler;
  for (const Index steps : ladder.steps)
    for (const bool second_order : {true, false}) {
      const char* method = second_order ? "galerkin" : "euler";
      const Measurement m =
          second_order ? by_galerkin(scene, backend, steps, request) : by_euler(scene, backend, steps, request);
      if (m.solved) (second_order ? galerkin : euler).push_back({steps, m.errors});
      report.rows.push_back(convergence_row(ladder, method, scene, steps, m));
      text.push_back({method, fmt::format("{}", steps), scientific(m.errors.y_L2), scientific(m.errors.x_L2),
                      scientific(m.errors.y_at_T), scientific(m.errors.x_at_T), fmt::format("{}", m.iterations),
                      format_seconds(median(m.seconds)), m.solved ? "solved" : m.reason});
      if (ladder.scene == "lq-control" && m.solved) report.rows.push_back(control_row(method, steps, scene.T, m));
    }
  print(fmt::format("{}, {}\n", ladder.scene, ladder.grid) + table(text) + "\n");
  for (const auto& [method, points] : {std::pair("galerkin", &galerkin), std::pair("euler", &euler)}) {
    Json orders = Json::object();
    std::string line;
    for (const auto& [name, norm] : norms) {
      const double order = observed_order(*points, norm);
      orders[name] = order;
      line += fmt::format("{}{} {}", line.empty() ? "" : ", ", name,
                          std::isnan(order) ? "exact to rounding" : fmt::format("{:.2f}", order));
    }
    report.rows.push_back({{"part", "order"},
                           {"scene", ladder.scene},
                           {"grid", ladder.grid},
                           {"method", method},
                           {"grids", points->size()},
                           {"order", orders}});
    if (!points->empty())
      report.notes.push_back(fmt::format("{}, {}, {}: order {}", ladder.scene, ladder.grid, method, line));
  }
}

void note_control(BenchReport& report) {
  std::map<std::string, long> first;
  for (const Json& row : report.rows)
    if (row["part"] == "control" && row["cost_error"] <= 1e-6 && row["switch_error"] <= 1e-6)
      first.emplace(row["method"], row["steps"]);
  for (const auto& [method, steps] : first)
    report.notes.push_back(fmt::format("lq-control, {}: switches and cost to 1e-6 from {} steps on", method, steps));
}

}  // namespace

// Example 5.1 of the paper has h of about 1e-3: 3 pi/1e-3 = 9424.8. Kinks of u are on the nodes with 9426 steps alone.
void study_ratios(const BenchRequest& request, Backend& backend, BenchReport& report) {
  const Scene scene = make_scene("bridge");
  std::vector<std::vector<std::string>> text{{"steps", "x(T)", "x in L2", "y in L2"}};
  for (const Index steps : {9424, 9425, 9426}) {
    const TimeErrors euler = by_euler(scene, backend, steps, request).errors;
    const TimeErrors galerkin = by_galerkin(scene, backend, steps, request).errors;
    Json row{{"part", "ratio"}, {"scene", "bridge"}, {"steps", steps}, {"h", scene.T / double(steps)}};
    for (const auto& [name, norm] : norms) row[name] = euler.*norm / galerkin.*norm;
    report.rows.push_back(row);
    text.push_back({fmt::format("{}", steps), scientific(euler.x_at_T / galerkin.x_at_T),
                    scientific(euler.x_L2 / galerkin.x_L2), scientific(euler.y_L2 / galerkin.y_L2)});
  }
  print("bridge, errors of implicit Euler over those of Galerkin\n" + table(text) + "\n");
}

void study_convergence(const BenchRequest& request, Backend& backend, BenchReport& report) {
  for (const TimeLadder& ladder : ladders(request.quick)) climb(ladder, request, backend, report);
  note_control(report);
}

}  // namespace bromwich::app
