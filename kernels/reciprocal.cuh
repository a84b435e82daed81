#pragma once

#include <cuda_runtime.h>

namespace bromwich::cuda {

/// 1/b to rounding: one third-order step from the 20-bit approximation.
__device__ inline double reciprocal(double b) {
  double r;
  asm("rcp.approx.ftz.f64 %0, %1;" : "=d"(r) : "d"(b));
  const double e = fma(-b, r, 1.0);
  return fma(r, fma(e, e, e), r);
}

}  // namespace bromwich::cuda
