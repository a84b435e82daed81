#include "core/base/error.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/states.hpp"
#include "core/result/located_solution.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/reductions.hpp"
#include "core/solve/solve.hpp"

#include <algorithm>
#include <numeric>
#include <string>

namespace bromwich {

namespace {

// Of a scene in its simplest form.
Matrix states_of(const Scene& scene, Backend& backend, const Result& result, const std::vector<Index>& rows) {
  if (const auto eliminated = scene.free_rows.empty() ? std::nullopt : eliminate_free(scene))
    return states_of(eliminated->scene, backend, eliminated->reduced(result), rows);
  return states_at_rows(discretise(scene, backend, result.steps), result.y, rows, result.defects.get());
}

void check_rows(const Result& result, const std::vector<Index>& rows) {
  for (const Index j : rows)
    if (j < 0 || j > result.steps)
      throw Error("rows", "found " + std::to_string(j), "rows are time points 0.." + std::to_string(result.steps));
  const Index last = rows.empty() ? 0 : *std::max_element(rows.begin(), rows.end());
  if (!result.y.topRows(last + 1).allFinite())
    throw Error("rows", "the result is not valid up to row " + std::to_string(last), "ask for earlier rows");
}

// Methods that locate switches; at jumps the limit from the left.
Matrix located_states(const Result& result, const std::vector<Index>& rows) {
  check_rows(result, rows);
  Matrix states(result.located->pieces.front().x.cols(), Index(rows.size()));
  for (std::size_t k = 0; k < rows.size(); ++k)
    states.col(Index(k)) = result.located->x(result.t[rows[k]], rows[k] > 0);
  return states;
}

void check(const Scene& scene, const Result& result, const std::vector<Index>& rows) {
  if (result.goal) throw Error("result", "is of method goal", "ask for its states when solving");
  if (scene.constraints() > 0 && (result.y.rows() != result.steps + 1 || result.y.cols() != scene.constraints()))
    throw Error("result", "its y does not have one row per time point and one column per constraint",
                "pass a result of this scene");
  if (by_euler(result) || !result.continuous)
    throw Error("result", "its y is not linear between time points", "ask for states when solving");
  check_rows(result, rows);
}

}  // namespace

Matrix states_at(const Scene& scene, Backend& backend, const Result& result, const std::vector<Index>& rows) {
  scene.validate();
  if (result.located) return located_states(result, rows);
  check(scene, result, rows);
  InnerOptions options;
  options.method = result.method;
  const Reductions reduced(scene, options, reductions_of_scene());
  Result known = result;
  reduced.there(known);
  Result states;
  states.x = states_of(reduced.scene(), backend, known, rows).transpose();
  states.x_components.resize(std::size_t(scene.states()));
  std::iota(states.x_components.begin(), states.x_components.end(), Index(0));
  reduced.back(states);
  return states.x.transpose();
}

}  // namespace bromwich
