// Goal-oriented grids of port-Hamiltonian scenes: violation of the energy balance over steps and over time, compared
// with uniform grids, the equidistributed grid and schemes of higher order.

#include "bench/studies/goal.hpp"

#include "app/commands.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "core/goal/indicators.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace bromwich::app {

namespace {

constexpr Index reference_halvings = 6;
constexpr Index most_reference_cells = 3200;  ///< of a grid; finer ones are not compared with the reference

struct GoalContestant {
  const char* name;
  StepScheme scheme;
  bool adapted;
  AdjointChoice adjoint = {};
  CellWeights weights = CellWeights::local;
  Refinement refinement = Refinement::bisection;
};

std::vector<GoalContestant> goal_contestants() {
  using enum StepScheme;
  const AdjointChoice one{AdjointMethod::jacobi, 1}, eight{AdjointMethod::jacobi, 8};
  return {{"euler, uniform", euler, false},
          {"euler, goal", euler, true},
          {"euler, goal, doubling", euler, true, {AdjointMethod::doubling, 1}},
          {"euler, goal, block-Jacobi 1", euler, true, one},
          {"euler, goal, block-Jacobi 8", euler, true, eight},
          {"euler, goal, paper's indicator", euler, true, {}, CellWeights::interpolated},
          {"euler, goal, paper's indicator, block-Jacobi 1", euler, true, one, CellWeights::interpolated},
          {"midpoint, uniform", midpoint, false},
          {"midpoint, goal", midpoint, true},
          {"exponential, uniform", exponential, false},
          {"exponential, goal", exponential, true},
          {"euler, divided", euler, true, {}, CellWeights::local, Refinement::division},
          {"midpoint, divided", midpoint, true, {}, CellWeights::local, Refinement::division}};
}

struct GoalRun {
  Vector t;
  RowMatrix x;
  Index cycles = 0;
  std::optional<double> effectivity, estimate;
};

GoalRun run_once(const GoalScene& s, Backend& backend, const GoalContestant& c, Index steps) {
  if (!c.adapted) {
    const Vector t = Vector::LinSpaced(steps + 1, 0, s.scene.T);
    return {t, trajectory(s, backend, c.scheme, t), 0, {}, {}};
  }
  Options options;
  options.method = Method::goal;
  options.steps = steps;
  options.states = StateSelection::all;
  GoalOptions goal;
  goal.scheme = c.scheme;
  goal.adjoint = c.adjoint;
  goal.weights = c.weights;
  goal.refinement = c.refinement;
  options.goal = std::make_shared<GoalOptions>(goal);
  Result result = solve(s.scene, backend, options);
  const GoalCycle& last = result.goal->history.back();
  return {std::move(result.t), std::move(result.x), result.cycles, last.effectivity, last.estimate};
}

Json row_of(const GoalScene& s, Backend& backend, const GoalContestant& c, Index steps, int repeats) {
  Samples samples;
  GoalRun run;
  for (int round = 0; round < repeats; ++round) {
    Timer timer;
    run = run_once(s, backend, c, steps);
    const double seconds = timer.lap();
    samples.add(seconds, 0, seconds);
  }
  Json row{{"scene", s.label},
           {"parameters", to_json(s.parameters)},
           {"contestant", c.name},
           {"scheme", to_string(c.scheme)},
           {"adapted", c.adapted},
           {"steps", run.t.size() - 1},
           {"cycles", run.cycles},
           {"effectivity", run.effectivity ? Json(*run.effectivity) : Json(nullptr)},
           {"estimate", run.estimate ? Json(*run.estimate) : Json(nullptr)},
           {"seconds", to_json(samples)}};
  row.update(judged(s, backend, c.scheme, run.t, run.x));
  return row;
}

/// The ladder with its diode: y is part of the balance, so method goal also computes the uniform grids.
Json switching_row(const SceneChoice& choice, Backend& backend, const Vector& at_end, StepScheme scheme, bool adapted,
                   Index steps, int repeats) {
  Options options;
  options.method = Method::goal;
  options.steps = steps;
  options.states = StateSelection::all;
  GoalOptions goal;
  goal.scheme = scheme;
  goal.first_cells = adapted ? std::min<Index>(steps, 50) : steps;
  options.goal = std::make_shared<GoalOptions>(goal);
  Samples samples;
  Result result;
  for (int round = 0; round < repeats; ++round) {
    result = solve(choice.scene, backend, options);
    samples.add(result.seconds.total, result.seconds.setup, result.seconds.solve);
  }
  const EnergyBalance& b = result.goal->balance;
  const Vector last = result.x.row(result.steps).transpose();
  const std::optional<double> effectivity = result.goal->history.back().effectivity;
  return {{"scene", choice.scene.name},
          {"parameters", to_json(choice.parameters)},
          {"contestant", fmt::format("{}, {}", to_string(scheme), adapted ? "goal" : "uniform")},
          {"scheme", to_string(scheme)},
          {"adapted", adapted},
          {"status", to_string(result.status)},
          {"steps", result.steps},
          {"cycles", result.cycles},
          {"effectivity", effectivity ? Json(*effectivity) : Json(nullptr)},
          {"violation", b.violation.cwiseAbs().sum()},
          {"I_loc", b.violation.squaredNorm()},
          {"I_glob", b.violation.sum() * b.violation.sum()},
          {"error_x_at_T", (last - at_end).cwiseAbs().maxCoeff()},
          {"seconds", to_json(samples)}};
}

Json switching_rows(Backend& backend, const std::vector<Index>& ladder, int repeats, bool quick) {
  const SceneChoice choice = choose_scene("ladder-diodes", {});
  Options march;
  march.method = Method::march;
  march.steps = quick ? 16000 : 128000;
  march.states = StateSelection::all;
  const Result fine = solve(choice.scene, backend, march);
  const Vector at_end = fine.x.row(fine.steps).transpose();
  Json rows = Json::array();
  for (const Index steps : ladder)
    for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint})
      for (const bool adapted : {false, true})
        rows.push_back(switching_row(choice, backend, at_end, scheme, adapted, steps, repeats));
  return rows;
}

double value_of(const Json& rows, const std::string& contestant, Index steps, const char* key) {
  for (const Json& row : rows)
    if (row["contestant"] == contestant && row["steps"] == steps && row["parameters"].size() == 0) return row[key];
  return std::nan("");
}

std::vector<std::string> conclusions(const Json& rows, Index steps) {
  const auto I = [&](const std::string& name) { return value_of(rows, name, steps, "I_loc"); };
  return {
      fmt::format(
          "ph-toy, {} steps of implicit Euler: I_loc {:.2e} on the uniform grid, {:.2e} on the goal-oriented one "
          "({:.1f} times less), {:.2e} on the equidistributed one",
          steps, I("euler, uniform"), I("euler, goal"), I("euler, uniform") / I("euler, goal"),
          I("euler, equidistributed")),
      fmt::format("ph-toy, {} steps, one sweep of block-Jacobi: {:.2e}; with the paper's indicator {:.2e}, and {:.2e} "
                  "with the exact adjoint",
                  steps, I("euler, goal, block-Jacobi 1"), I("euler, goal, paper's indicator, block-Jacobi 1"),
                  I("euler, goal, paper's indicator"))};
}

}  // namespace

GoalScene::GoalScene(std::string label_, const std::string& name, ParameterValues parameters_)
    : label(std::move(label_)),
      parameters(std::move(parameters_)),
      scene(make_scene(name, parameters)),
      system(*scene.port, scene.T) {}

RowMatrix trajectory(const GoalScene& s, Backend& backend, StepScheme scheme, const Vector& t) {
  const auto chain = backend.step_chain(s.system.step_problem(scheme, group_steps(t)));
  return chain->solve(step_sources(s.system, scheme, t, s.scene.x0));
}

Json judged(const GoalScene& s, Backend& backend, StepScheme scheme, const Vector& t, const RowMatrix& x) {
  Json json;
  const auto add = [&](StepScheme as, const std::string& suffix) {
    const EnergyBalance b = energy_balance({s.system, as, t, x});
    json["violation" + suffix] = b.violation.cwiseAbs().sum();
    json["I_loc" + suffix] = b.violation.squaredNorm();
    json["I_glob" + suffix] = b.violation.sum() * b.violation.sum();
    if (suffix.empty()) json["supplied"] = b.supplied.sum(), json["dissipated"] = b.dissipated.sum();
  };
  add(scheme, "");
  add(StepScheme::euler, "_right");
  add(StepScheme::midpoint, "_linear");
  json["error_x"] = nullptr;
  if (t.size() - 1 <= most_reference_cells) {
    Vector fine = t;
    for (Index k = 0; k < reference_halvings; ++k) fine = halved(fine);
    const RowMatrix exact = trajectory(s, backend, StepScheme::exponential, fine);
    double worst = 0;
    for (Index i = 0; i < t.size(); ++i)
      worst = std::max(worst, (x.row(i) - exact.row(i << reference_halvings)).cwiseAbs().maxCoeff());
    json["error_x"] = worst;
  }
  return json;
}

namespace {

/// |x'| in the norm of the energy at the left ends of the steps of a grid that contains the jumps.
Vector speeds(const GoalScene& s, Backend& backend, const Vector& t) {
  const RowMatrix x = trajectory(s, backend, StepScheme::exponential, t);
  const RowMatrix slope = slopes({s.system, StepScheme::exponential, t, x}, Side::behind);
  return (slope * s.system.energy_matrix()).cwiseProduct(slope).rowwise().sum().cwiseMax(0).cwiseSqrt();
}

/// T^3 ∫ |x'|^4 / (∫ |x'|)^4: gain of the equidistributed grid in I_loc of implicit Euler, for many steps.
double equidistribution_gain(const GoalScene& s, Backend& backend) {
  const Vector t = first_grid(s.scene.T, 50000, input_jumps(*s.scene.port, s.scene.T));
  const Vector speed = speeds(s, backend, t), h = t.tail(t.size() - 1) - t.head(t.size() - 1);
  return std::pow(s.scene.T, 3) * h.dot(speed.array().pow(4).matrix()) / std::pow(h.dot(speed), 4);
}

}  // namespace

Vector equidistributed(const GoalScene& s, Backend& backend, Index M) {
  const std::vector<double> jumps = input_jumps(*s.scene.port, s.scene.T);
  const Vector fine = first_grid(s.scene.T, 50000, jumps);
  const Vector speed = speeds(s, backend, fine);
  Vector length = Vector::Zero(fine.size());
  for (Index i = 0; i < speed.size(); ++i) length[i + 1] = length[i] + (fine[i + 1] - fine[i]) * speed[i];
  // Cells end at the jumps: each piece gets its share of the cells.
  std::vector<double> t{0};
  std::vector<Index> ends;
  for (const double jump : jumps) ends.push_back(std::lower_bound(fine.begin(), fine.end(), jump) - fine.begin());
  ends.push_back(fine.size() - 1);
  Index from = 0, left = M;
  for (std::size_t piece = 0; piece < ends.size(); ++piece) {
    const Index to = ends[piece];
    const double rest = length[fine.size() - 1] - length[from];
    const Index cells = piece + 1 == ends.size()
                            ? left
                            : std::max<Index>(1, Index(std::lround(double(left) * (length[to] - length[from]) / rest)));
    for (Index i = 1, k = from; i <= cells; ++i) {
      const double wanted = length[from] + (length[to] - length[from]) * double(i) / double(cells);
      while (k + 1 < to && length[k + 1] < wanted) ++k;
      const double share = (wanted - length[k]) / (length[k + 1] - length[k]);
      t.push_back(i == cells ? fine[to] : fine[k] + share * (fine[k + 1] - fine[k]));
    }
    from = to;
    left -= cells;
  }
  return Eigen::Map<const Vector>(t.data(), Index(t.size()));
}

namespace {

/// Implicit Euler on a grid with equal h |x'| in all cells.
Json equidistributed_row(const GoalScene& s, Backend& backend, Index steps) {
  const Vector t = equidistributed(s, backend, steps);
  Json row{{"scene", s.label},
           {"parameters", to_json(s.parameters)},
           {"contestant", "euler, equidistributed"},
           {"scheme", "euler"},
           {"adapted", false},
           {"steps", steps},
           {"cycles", 0},
           {"effectivity", nullptr},
           {"estimate", nullptr},
           {"seconds", nullptr}};
  row.update(judged(s, backend, StepScheme::euler, t, trajectory(s, backend, StepScheme::euler, t)));
  return row;
}

std::vector<std::vector<std::string>> lines_of(const Json& rows) {
  std::vector<std::vector<std::string>> lines{
      {"scene", "contestant", "steps", "I_loc", "violation", "error of x", "time"}};
  for (const Json& row : rows) {
    const Json& error = row["error_x"];
    lines.push_back({row["scene"], row["contestant"], fmt::format("{}", row["steps"].get<Index>()),
                     scientific(row["I_loc"]), scientific(row["violation"]),
                     error.is_null() ? "-" : scientific(error.get<double>()),
                     row["seconds"].is_null() ? "-" : format_seconds(row["seconds"]["median"])});
  }
  return lines;
}

}  // namespace

BenchReport bench_goal(const BenchRequest& request, Backend& backend) {
  if (request.scene || !request.settings.empty())
    throw Error(request.scene ? "SCENE" : "--set", "this benchmark has its own scenes", "leave it out");
  BenchReport report;
  report.scene = "ph-toy, ladder";
  report.details = {
      {"violation",
       "sum over the steps of |v|, v the violation of the energy balance with the scheme's own reconstruction"},
      {"I_loc", "sum over the steps of v^2"},
      {"I_glob", "(sum over the steps of v)^2"},
      {"_right",
       "the same of the time points with right end points as quadrature, as the paper takes it for all solvers"},
      {"_linear", "the same of straight lines between the time points"},
      {"error_x", "largest error of a state at a time point, against 64 exponential steps in each step"},
      {"seconds", "wall clock; goal-oriented: all grids from 20 steps on"},
      {"equidistributed",
       "equal h |x'| in all cells, from the known solution: the least I_loc of implicit Euler for many"
       " steps"}};
  std::vector<Index> ladder{25, 50, 100, 200, 400, 800, 1600};
  if (request.quick) ladder = {50, 200};
  if (request.steps > 0) ladder = {request.steps};
  std::vector<GoalScene> scenes;
  scenes.emplace_back("ph-toy", "ph-toy", ParameterValues{});
  scenes.emplace_back("ph-toy, u = 0", "ph-toy", ParameterValues{{"u", 0}});
  scenes.emplace_back("ph-toy, u = 0, 0.6 R", "ph-toy", ParameterValues{{"u", 0}, {"r", 0.6}});
  scenes.emplace_back("ladder", "ladder", ParameterValues{});

  for (const GoalScene& s : scenes)
    report.details["equidistribution_gain"][s.label] = equidistribution_gain(s, backend);
  for (const GoalScene& s : scenes)
    for (const Index steps : ladder) {
      for (const GoalContestant& c : goal_contestants())
        report.rows.push_back(row_of(s, backend, c, steps, request.repeats()));
      report.rows.push_back(equidistributed_row(s, backend, steps));
    }
  report.details["switching"] = switching_rows(backend, ladder, request.repeats(), request.quick);
  report.details["figures"] = goal_figures(backend, request.quick);
  report.notes = conclusions(report.rows, ladder.size() > 3 ? 200 : ladder.back());
  print_with_notes(table(lines_of(report.rows)), report);
  return report;
}

}  // namespace bromwich::app
