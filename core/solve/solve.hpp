#pragma once
// The entry: solves a scene on a backend and returns a certified result.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// Solves the scene on t_j = j T/J. Throws Error for bad input; every other outcome is a Status in the result.
Result solve(const Scene&, Backend&, const Options& = {});

/// The whole state at chosen time points (rows of the result): m x rows.size(), from the y of a solved result and a few
/// shifted solves per time point. Throws Error for rows that are not there, or a result of another scene or of euler.
Matrix states_at(const Scene&, Backend&, const Result&, const std::vector<Index>& rows);

}  // namespace bromwich
