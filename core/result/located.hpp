#pragma once
// What the rows of a result of method shooting are: of initial values those of the steps of march, of boundary values
// those of located events, from the x(0) that it has found.

#include "result.hpp"

namespace bromwich {

/// Switches are located, and not known to a step.
inline bool locates_switches(const Result& result) {
  return locates_switches(result.method) && (result.method != Method::shooting || result.start.size() > 0);
}
/// Of a march on an adapted grid, whose steps are more than the rows.
inline bool has_own_steps(const Result& result) {
  return result.method == Method::march && result.errors && !result.errors->grids.empty() &&
         result.errors->grids.back() > result.steps;
}
/// The rows are the discrete solution of the steps of method march.
inline bool has_steps_of_march(const Result& result) {
  return result.method == Method::march || result.method == Method::contour || result.method == Method::multigrid ||
         (result.method == Method::shooting && !locates_switches(result));
}

}  // namespace bromwich
