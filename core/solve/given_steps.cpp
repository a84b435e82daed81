#include "core/solve/given_steps.hpp"

#include "core/solve/galerkin_control.hpp"
#include "core/solve/one_grid.hpp"
#include "core/solve/reductions.hpp"

namespace bromwich {

Result solve_on_steps(const Scene& scene, Backend& backend, const InnerOptions& options) {
  const Reductions reduced(scene, options, reductions_of_grid());
  const auto solve = reduced.options().method == Method::galerkin ? by_galerkin : solve_on_one_grid;
  return reduced.of_solve(solve(reduced.scene(), backend, reduced.options()));
}

}  // namespace bromwich
