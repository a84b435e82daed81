#include "core/base/error.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/states.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/solve.hpp"

#include <algorithm>
#include <string>

namespace bromwich {

Matrix states_at(const Scene& scene, Backend& backend, const Result& result, const std::vector<Index>& rows) {
  scene.validate();
  if (const auto reduced = without_mass(scene)) return states_at(*reduced, backend, result, rows);
  if (result.goal) throw Error("result", "is of method goal", "ask for its states when solving");
  if (scene.constraints() == 0)
    return states_at(with_idle_constraint(scene), backend, with_idle_constraint(result), rows);
  if (result.y.rows() != result.steps + 1 || result.y.cols() != scene.constraints())
    throw Error("result", "its y does not have one row per time point and one column per constraint",
                "pass a result of this scene");
  if (by_euler(result) || !result.continuous)
    throw Error("result", "its y is not linear between time points", "ask for states when solving");
  if (const auto eliminated = scene.free_rows.empty() ? std::nullopt : eliminate_free(scene))
    return states_at(eliminated->scene, backend, eliminated->reduced(result), rows);
  Index last = 0;
  for (const Index j : rows) {
    if (j < 0 || j > result.steps)
      throw Error("rows", "found " + std::to_string(j), "rows are time points 0.." + std::to_string(result.steps));
    last = std::max(last, j);
  }
  if (!result.y.topRows(last + 1).allFinite())
    throw Error("rows", "the result is not valid up to row " + std::to_string(last), "ask for earlier rows");
  return states_at_rows(discretise(scene, backend, result.steps), result.y, rows, result.defects.get());
}

}  // namespace bromwich
