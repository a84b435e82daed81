#pragma once

namespace bromwich {

/// What the device can do at best, measured.
struct CudaCeilings {
  double copy_bytes_per_second = 0;  ///< device to device, bytes read and written, arrays of several gigabytes
  double gemm_flops_per_second = 0;  ///< double precision, 8192 x 8192 x 8192, random values
};

/// Throws Error where there is no device.
CudaCeilings cuda_ceilings();

}  // namespace bromwich
