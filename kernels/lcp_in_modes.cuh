#pragma once
// What a sweep of the functional iteration does between two convolutions, in one kernel with a block a row:
//
//     v = S v^,   y <- SOL(M + D, r + v - D y),   y^ = S y.

#include "kernels/lcp_tridiagonal.cuh"
#include "kernels/transform_rows.cuh"

#include <cstddef>

namespace bromwich::cuda {

/// The arrays of modes, and the tables of S.
struct Modes {
  const double* v;  ///< null: v is given as it is
  double* y;        ///< null: not wanted
  SineTables sine;
};

/// The kernel, and how it is started.
struct LcpInModes {
  void (*kernel)(LcpArrays, Modes, Coefficients<true>, Problem, OutcomeTarget) = nullptr;
  int threads = 0, rows = 1;  ///< of a block, and of a thread
  std::size_t bytes = 0;      ///< of shared memory of a block
};

/// For problems of n rows, n + 1 = 64, 128, ... 1024; no kernel for others.
LcpInModes lcp_in_modes(Index n);

}  // namespace bromwich::cuda
