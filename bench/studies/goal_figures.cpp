// The figures of Bartel and Schaller, Goal-oriented time adaptivity for port-Hamiltonian systems, as numbers.

#include "bench/studies/goal.hpp"
#include "core/goal/grid_adaptation.hpp"
#include "core/goal/indicators.hpp"

#include <fmt/format.h>

namespace bromwich::app {

namespace {

constexpr Index most_curve_points = 250;  ///< of a curve

/// Rounded to five digits, enough for a picture.
Json numbers(const Vector& values) {
  Json json = Json::array();
  for (const double value : values) json.push_back(std::stod(fmt::format("{:.5g}", value)));
  return json;
}

/// Every `stride`-th value, and the last.
Vector thinned(const Vector& values, Index stride) {
  const Index last = values.size() - 1, count = (last + stride - 1) / stride;
  return Vector::NullaryExpr(count + 1, [&](Index i) { return values[std::min(i * stride, last)]; });
}

Index stride_of(Index steps) { return (steps + most_curve_points - 1) / most_curve_points; }

Json columns(const RowMatrix& x, const std::vector<Index>& chosen) {
  Json json = Json::array();
  for (const Index c : chosen) json.push_back(numbers(thinned(x.col(c), stride_of(x.rows() - 1))));
  return json;
}

/// Fig. 1: |l| of an error of the balance at T/2, exact and by one sweep of block-Jacobi.
Json adjoints(Backend& backend, Index M) {
  Json json = Json::array();
  for (const double variant : {1, 2, 3}) {
    const GoalScene s("ph-toy", "ph-toy", {{"variant", variant}});
    const Vector t = Vector::LinSpaced(M + 1, 0, s.scene.T);
    const auto chain = backend.step_chain(
        step_chain_problem(StepScheme::euler, s.system.step_matrix(StepScheme::euler), group_steps(t)));
    RowMatrix q = RowMatrix::Zero(M + 1, s.system.states());
    q.row(M / 2).setConstant(5);
    Json curve{{"variant", variant}, {"t", numbers(t)}};
    for (const auto& [name, choice] :
         {std::pair("exact", AdjointChoice{}), std::pair("jacobi_1", AdjointChoice{AdjointMethod::jacobi, 1}),
          std::pair("jacobi_8", AdjointChoice{AdjointMethod::jacobi, 8})})
      curve[name] = numbers(chain->solve_transposed(q, choice).rowwise().norm());
    json.push_back(curve);
  }
  return json;
}

/// Fig. 1, and why the estimate of a block-Jacobi adjoint misses most of the error where modes are undamped.
Json saturation(Backend& backend, const std::vector<Index>& ladder) {
  Json json = Json::array();
  for (const double variant : {1, 2, 3})
    for (const Index M : ladder) {
      const GoalScene s("ph-toy", "ph-toy", {{"variant", variant}});
      const Vector t = Vector::LinSpaced(M + 1, 0, s.scene.T);
      const auto chain = backend.step_chain(
          step_chain_problem(StepScheme::euler, s.system.step_matrix(StepScheme::euler), group_steps(t)));
      const RowMatrix x = chain->solve(step_sources(s.system, StepScheme::euler, t, s.scene.x0));
      const RowMatrix q = local_balance()->gradient({s.system, StepScheme::euler, t, x});
      const RowMatrix exact = chain->solve_transposed(q, {}).bottomRows(M);
      Json row{{"variant", variant}, {"steps", M}};
      for (const Index sweeps : {1, 8, 64}) {
        const RowMatrix l = chain->solve_transposed(q, {AdjointMethod::jacobi, sweeps}).bottomRows(M);
        row[fmt::format("error_{}", sweeps)] = (l - exact).norm() / exact.norm();
      }
      json.push_back(row);
    }
  return json;
}

Json curve(const GoalScene& s, StepScheme scheme, const Vector& t, const RowMatrix& x,
           const std::vector<Index>& shown) {
  const EnergyBalance b = energy_balance({s.system, scheme, t, x});
  const Index M = t.size() - 1, stride = stride_of(M);
  const Vector h = t.tail(M) - t.head(M);
  return {{"t", numbers(thinned(t, stride))}, {"x", columns(x, shown)},
          {"h", numbers(thinned(h, stride))}, {"violation", numbers(thinned(b.violation, stride))},
          {"supplied", b.supplied.sum()},     {"steps", M}};
}

/// Fig. 2, 3 and 6: trajectories and their violations on goal-oriented and uniform grids, and the exact ones.
Json trajectories(Backend& backend, const GoalScene& s, const std::vector<Index>& shown,
                  const std::vector<std::tuple<std::string, GoalOptions, Index>>& entrants) {
  Json json = Json::array();
  const Vector fine = first_grid(s.scene.T, 400, input_jumps(*s.scene.port, s.scene.T));
  const Vector times = halved(halved(fine));
  const RowMatrix exact = trajectory(s, backend, StepScheme::exponential, times);
  for (const auto& [name, goal, steps] : entrants) {
    Options options;
    options.method = Method::goal;
    options.steps = steps;
    options.states = StateSelection::all;
    options.goal = std::make_shared<GoalOptions>(goal);
    const Result result = solve(s.scene, backend, options);
    const Vector uniform = Vector::LinSpaced(result.steps + 1, 0, s.scene.T);
    Json history = Json::array();
    for (const GoalCycle& c : result.goal->history) {
      const Vector even = Vector::LinSpaced(c.cells + 1, 0, s.scene.T);
      const RowMatrix x = trajectory(s, backend, goal.scheme, even);
      const auto quantity = goal.quantity ? goal.quantity : local_balance();
      history.push_back({{"steps", c.cells},
                         {"quantity", c.quantity},
                         {"uniform", quantity->value({s.system, goal.scheme, even, x})},
                         {"estimate", c.estimate},
                         {"absolute", c.absolute},
                         {"effectivity", c.effectivity ? Json(*c.effectivity) : Json(nullptr)}});
    }
    const auto wanted = goal.quantity ? goal.quantity : local_balance();
    const Trajectory known{s.system, StepScheme::exponential, times, exact};
    const double exact_quantity = wanted->exact().value_or(wanted->value(known));
    json.push_back(
        {{"name", name},
         {"scene", s.label},
         {"exact_quantity", exact_quantity},
         {"components", shown},
         {"goal", curve(s, goal.scheme, result.t, result.x, shown)},
         {"uniform", curve(s, goal.scheme, uniform, trajectory(s, backend, goal.scheme, uniform), shown)},
         {"exact", {{"t", numbers(thinned(times, stride_of(times.size() - 1)))}, {"x", columns(exact, shown)}}},
         {"history", history}});
  }
  return json;
}

GoalOptions goal_with(std::shared_ptr<const QuantityOfInterest> quantity, AdjointChoice adjoint) {
  GoalOptions goal;
  goal.quantity = std::move(quantity);
  goal.adjoint = adjoint;
  return goal;
}

GoalOptions cycles(Index count, double marking, Index first) {
  GoalOptions goal;
  goal.cycles = count;
  goal.marking = marking;
  goal.first_cells = first;
  return goal;
}

}  // namespace

Json goal_figures(Backend& backend, bool quick) {
  const AdjointChoice exact, jacobi{AdjointMethod::jacobi, 1};
  const GoalScene toy("ph-toy", "ph-toy", {}), ladder("ladder", "ladder", {});
  const Index steps = quick ? 100 : 200;
  Json json;
  json["adjoints"] = adjoints(backend, 200);
  json["saturation"] =
      saturation(backend, quick ? std::vector<Index>{100, 400} : std::vector<Index>{100, 200, 400, 800, 1600, 3200});
  json["toy"] = trajectories(backend, toy, {0, 1, 2},
                             {{"I_loc, exact adjoint", goal_with(local_balance(), exact), steps},
                              {"I_loc, block-Jacobi 1", goal_with(local_balance(), jacobi), steps},
                              {"I_loc + 10 |x|^2, exact adjoint", goal_with(weighted_balance(10), exact), steps},
                              {"I_loc + 10 |x|^2, block-Jacobi 1", goal_with(weighted_balance(10), jacobi), steps}});
  json["ladder"] =
      trajectories(backend, ladder, {0, 1, 15},
                   {{"20 cycles", cycles(20, 0, 20), 0}, {"60 cycles, a quarter marked", cycles(60, 0.25, 100), 0}});
  return json;
}

}  // namespace bromwich::app
