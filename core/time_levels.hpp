#pragma once
// The time grids of a multigrid method: J, J/2, J/4, ... steps.
//
// What is piecewise linear on a coarse grid is so on the finer one too: with I the interpolation,
// (K_c y)_i = (K I y)_{2i}, or for tabulated weights
//
//     W^c_0 = W_0 + W_1/2,   W^c_d = W_{2d-1}/2 + W_{2d} + W_{2d+1}/2,   S^c_d = S_{2d} + W_{2d-1}/2      (d >= 1).
//
// symbol    variable   shape          meaning
// K         kernel     -              discrete convolution of this grid
// r         r          (J_l+1) x n    right-hand side of this grid's problem y in SOL(M, r + K y)
// y         y          (J_l+1) x n    its iterate; row 0 is y_0 and never changes
// v         v          (J_l+1) x n    K y, and what is made of it
// y~        old        (J_l+1) x n    y as the cycle found it
// D         shift      1              smoothing solves LCP(M + D I, .), see core/smoothing.hpp

#include "functional_iteration.hpp"

#include <variant>
#include <vector>

namespace bromwich {

struct TimeLevel {
  Index steps = 0;
  std::variant<Recurrence, LagTable> weights;
  std::unique_ptr<SpaceTimeKernel> kernel;
  std::unique_ptr<Array> r, y, v, old;
  std::unique_ptr<LcpBatch> lcp;  ///< with M + D I
  double shift = 0;
  std::unique_ptr<March> march;  ///< of the coarsest grid only, in place of `lcp`

  std::size_t bytes() const;
};

struct TimeLevels {
  std::vector<std::unique_ptr<TimeLevel>> grids;  ///< finest first; what points to one stays valid
  std::string description;                        ///< of the kernel and the grids
  double kernel_error = 0;                        ///< see Result::kernel_error

  TimeLevel& operator[](std::size_t l) { return *grids[l]; }
  std::size_t size() const { return grids.size(); }
};

/// The grids on which a sweep contracts where it stands: kappa_0 < 1/2 (core/forecast.hpp), so that M + W_0 is in the
/// class of M there; at least `fewest_steps` each. r of the finest holds the response, those of the others its values
/// at their time points; y is zero. `kernel` is that of sparse dynamics, otherwise null.
TimeLevels time_levels(const DiscreteProblem&, const SparseKernel* kernel, const Options&);

inline constexpr Index fewest_steps = 8;

/// The weights of the grid with half the steps.
LagTable coarsen(const LagTable&);

}  // namespace bromwich
