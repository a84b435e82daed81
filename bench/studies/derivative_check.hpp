#pragma once
// A derivative of a scene against central differences of solves.

#include "core/seam/backend.hpp"
#include "derivatives/solution_derivative.hpp"

#include <map>
#include <string>

namespace bromwich::app {

enum class Verdict {
  agrees,     ///< all errors are below the tolerance of their kind
  undecided,  ///< some are not, but ten times the noise of the differences is as large
  differs
};

struct DerivativeCheck {
  Index states = 0, constraints = 0, steps = 0;
  std::string kind;    ///< "discrete", "in modes", "over all times", "boundary" or "located"; empty: none
  std::string reason;  ///< why there is none
  double T = 0;        ///< half of that of the scene, or less, where solutions grow so that rounding hides differences
  double margin = NAN;
  /// By x0, f, g, A, B, N, M, E: the largest difference over the largest change, of y or x, whichever is larger.
  std::map<std::string, double> error;
  /// Likewise, of two differences of the discrete solution with steps of 1 : 2, what rounding of the solves leaves.
  std::map<std::string, double> noise;
  std::map<std::string, std::string> refused;  ///< the same data where jvp refuses a change, and why
  double identity = NAN;                       ///< |<u, Jv> - <J^T u, v>| / (|u| |Jv|), the largest of all data

  double largest_error() const;
  double largest_noise() const;
  Verdict verdict() const;
};

/// Of the discrete solution where y is continuous, with located switches where it may jump. The changes are drawn; f
/// and g change linearly in time. Of `grids` grids from `steps` on the one with the largest margin is taken, as a
/// difference needs a step below the margin. A difference with located switches is the best one of several steps.
DerivativeCheck check_derivatives(const Scene&, Backend&, Index steps, Index grids);

inline constexpr double expected_discrete = 1e-6, expected_located = 1e-4;

}  // namespace bromwich::app
