#pragma once
// A sweep of the functional iteration between two convolutions, in one kernel with one block per row:
//
//     v = S v^,   y <- SOL(M + D, r + v - D y),   y^ = S y.

#include "kernels/lcp_tridiagonal.cuh"
#include "kernels/transform_rows.cuh"

#include <cstddef>

namespace bromwich::cuda {

/// The arrays in modes, and the tables of S.
struct Modes {
  const double* v;  ///< null: LcpArrays::v is used as it is
  double* y;        ///< null: not needed
  SineTables sine;
};

/// The kernel and its launch configuration.
struct LcpInModes {
  void (*kernel)(LcpArrays, Modes, Coefficients<true>, Problem, OutcomeTarget) = nullptr;
  int threads = 0, rows = 1;  ///< threads per block, rows per thread
  std::size_t bytes = 0;      ///< of shared memory per block
};

/// For problems of n rows, n + 1 = 64, 128, ..., 1024; no kernel otherwise.
LcpInModes lcp_in_modes(Index n);

}  // namespace bromwich::cuda
