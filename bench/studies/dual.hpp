#pragma once
// Shared by the parts of the study of cycles in w: contraction and sweeps (dual.cpp), times at equal errors
// (dual_times.cpp).

#include "bench/studies/study.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// What a backend can do in the time that a study may take.
struct DualReach {
  double seconds;        ///< of the grids of one rule: further grids are listed as not run
  double most_values;    ///< n J of a grid
  double most_referred;  ///< n J of a reference
  double most_marched;   ///< J n^2 of marching on one core
  double longest_run;    ///< seconds, where times at an equal error are compared
};
DualReach dual_reach(const Backend& backend, bool quick);

Options dual_options(Method method, Index J, bool by_euler = false);

/// w at the time points, from the trace.
RowMatrix gap_of(const Scene& scene, const Result& r);

/// Largest difference at the time points that both have, from row 1 on.
double difference_of_grids(const RowMatrix& a, const RowMatrix& b);

/// Steps are doubled until the error of w is below `wanted_dual_error`: dual on the backend, march and euler on one
/// core. Adds rows to the report. Returns a table.
inline constexpr double wanted_dual_error = 1e-4;
std::string compare_dual_times(Backend& backend, double Q, bool quick, BenchReport& report);

/// Ratios of these times, a line for each backend and size.
std::vector<std::string> notes_on_dual_times(const Json& rows);

}  // namespace bromwich::app
