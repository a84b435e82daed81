#pragma once
// Hardware limits measured on the device, for comparison with the CUDA backend. Throws Error if there is no device.

#include "core/base/types.hpp"

namespace bromwich {

struct CudaCeilings {
  double copy_bytes_per_second = 0;  ///< copy of 2 GiB on the device; bytes read plus bytes written
  double gemm_flops_per_second = 0;  ///< DGEMM of order 8192; a multiply-add counts as two
};
CudaCeilings cuda_ceilings();

/// Seconds of the sine transform of n points for this many rows in its two forms. The backend uses one of them.
struct CudaTransformSeconds {
  double product = 0, fft = 0;
};
CudaTransformSeconds cuda_transform_seconds(Index n, Index rows);

}  // namespace bromwich
