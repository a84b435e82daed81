#pragma once
// What operations of the CUDA backend are held against, measured on the device. Throws Error where there is none.

#include "core/base/types.hpp"

namespace bromwich {

struct CudaCeilings {
  double copy_bytes_per_second = 0;  ///< of a copy of 2 GiB on the device, read and written bytes together
  double gemm_flops_per_second = 0;  ///< of a DGEMM of order 8192, a multiply-add being two
};
CudaCeilings cuda_ceilings();

/// Seconds of the sine transform of n points and so many rows in its two forms; the backend takes one of them.
struct CudaTransformSeconds {
  double product = 0, fft = 0;
};
CudaTransformSeconds cuda_transform_seconds(Index n, Index rows);

}  // namespace bromwich
