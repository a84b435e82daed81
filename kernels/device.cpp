#include "kernels/device.hpp"

#include "core/base/error.hpp"

#include <string>

namespace bromwich::cuda {

void check(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  cudaGetLastError();  // reported here, so clear it
  const char* remedy = status == cudaErrorMemoryAllocation ? "use fewer steps or a smaller scene, or the cpu backend"
                                                           : "check the device with nvidia-smi, or use the cpu backend";
  throw Error("cuda", std::string(what) + " failed: " + cudaGetErrorString(status), remedy,
              status == cudaErrorMemoryAllocation ? ErrorKind::does_not_fit : ErrorKind::device);
}

Device::Device(int number) : number_(number), fetcher_(number) {
  use();
  check(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, number), "asking the device");
  check(cudaDeviceGetAttribute(&shared_memory_, cudaDevAttrMaxSharedMemoryPerBlockOptin, number), "asking the device");
  check(cudaDeviceGetAttribute(&major_, cudaDevAttrComputeCapabilityMajor, number), "asking the device");
  check(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
  blocks_.emplace(stream_);
  // The pool keeps freed memory, so plans do not wait for the driver again.
  cudaMemPool_t pool;
  check(cudaDeviceGetDefaultMemPool(&pool, number), "asking for the memory pool");
  std::uint64_t keep = ~std::uint64_t(0);
  check(cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keep), "setting up the memory pool");
}

void Device::use() const {
  int now = -1;
  if (cudaGetDevice(&now) != cudaSuccess || now != number_) check(cudaSetDevice(number_), "choosing the device");
}

// In a stream capture only a kernel-to-kernel edge supports programmatic launch. After streams have joined, several
// nodes precede the kernel, and all of them must end.
bool Device::may_overlap() const {
  if (major_ < 9) return false;
  cudaStreamCaptureStatus status = cudaStreamCaptureStatusNone;
  const cudaGraphNode_t* before = nullptr;
  const cudaGraphEdgeData* edges = nullptr;
  std::size_t count = 0;
#if CUDART_VERSION >= 13000
  check(cudaStreamGetCaptureInfo(stream_, &status, nullptr, nullptr, &before, &edges, &count), "recording operations");
#else
  check(cudaStreamGetCaptureInfo_v3(stream_, &status, nullptr, nullptr, &before, &edges, &count),
        "recording operations");
#endif
  if (status == cudaStreamCaptureStatusNone) return true;
  cudaGraphNodeType type = cudaGraphNodeTypeEmpty;
  if (count == 1) check(cudaGraphNodeGetType(before[0], &type), "recording operations");
  return type == cudaGraphNodeTypeKernel;
}

Device::~Device() {
  kept_.clear();
  blocks_.reset();
  cudaStreamSynchronize(stream_);
  cudaStreamDestroy(stream_);
}

}  // namespace bromwich::cuda
