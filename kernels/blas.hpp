#pragma once
// The cuBLAS handle shared by the plans of a device.

#include "core/base/error.hpp"
#include "kernels/device.hpp"

#include <cublas_v2.h>

#include <memory>
#include <string>

namespace bromwich::cuda {

/// Throws Error("cuda", ...) with the status of cuBLAS.
inline void check(cublasStatus_t status, const char* what) {
  if (status != CUBLAS_STATUS_SUCCESS)
    throw Error("cuda", std::string(what) + " failed: " + cublasGetStatusString(status), "use the cpu backend",
                ErrorKind::device);
}

struct Blas {
  explicit Blas(const Device& device) {
    check(cublasCreate(&handle), "starting cuBLAS");
    check(cublasSetStream(handle, device.stream()), "starting cuBLAS");
  }
  ~Blas() { cublasDestroy(handle); }
  Blas(const Blas&) = delete;
  Blas& operator=(const Blas&) = delete;

  cublasHandle_t handle = nullptr;
};

/// Made once per device: initialising cuBLAS takes longer than most solves.
inline std::shared_ptr<Blas> shared_blas(const Device& device) {
  return device.shared<Blas>([](const Blas&) { return true; }, [&] { return std::make_shared<Blas>(device); });
}

}  // namespace bromwich::cuda
