#pragma once
// Rows between the time points of a result by steps from the time point before.

#include "../base/types.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <vector>

namespace bromwich {

/// t = t_row + part h, 0 <= part < 1.
struct Place {
  Index row;
  double part;
};

inline constexpr double same_point = 1e-9;  ///< of a step: written with fewer digits a time point still is one

/// Throws Error for t outside [0, T].
Place place(const Result&, double T, double t);
bool on_grid(const std::vector<Place>&);

/// Whether y is not a line between time points, or its state there cannot be computed from it.
bool by_steps(const Scene&, const Result&);

/// By the method of the result, from the time point before: where y jumps from step to step this is its state, its y,
/// and the integral of y from there.
void sample_by_steps(const Scene&, Backend&, const Result&, const std::vector<Place>&, Result& sampled);

/// Row k, and the integral of y over the step, by a march over the length s that is left, from the state x at the time
/// point t before. False if it is not solved.
bool sample_by_a_step(const Scene&, Backend&, double t, double s, const Vector& x, Index k, Result& sampled);

}  // namespace bromwich
