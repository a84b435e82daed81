#include "kernels/nccl_communicator.hpp"

#include "core/base/error.hpp"
#include "core/seam/shared_memory.hpp"
#include "kernels/device.hpp"

#include <nccl.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <string>

namespace bromwich {

namespace {

using cuda::check;

constexpr Index most_together = Index(1) << 24;  ///< values of a broadcast in one piece: 128 MiB of each device

void checked(ncclResult_t status, const char* what) {
  if (status == ncclSuccess) return;
  throw Error("NCCL", std::string(what) + " failed: " + ncclGetErrorString(status),
              "see what NCCL_DEBUG=INFO says, or run it on one rank", ErrorKind::device);
}

/// Values on the device, as many as the longest message so far needed.
class Buffer {
 public:
  ~Buffer() { cudaFree(values_); }
  double* of(Index count) {
    if (count > size_) {
      cudaFree(values_);
      values_ = nullptr;
      size_ = 0;
      check(cudaMalloc(&values_, sizeof(double) * std::size_t(count)), "allocating device memory");
      size_ = count;
    }
    return values_;
  }

 private:
  double* values_ = nullptr;
  Index size_ = 0;
};

class NcclCommunicator final : public Communicator {
 public:
  NcclCommunicator(int rank, int size, const ncclUniqueId& id, SharedMemory::Place place)
      : Communicator(rank, size), device_(place.number), stream_(reinterpret_cast<cudaStream_t>(place.stream)) {
    check(cudaSetDevice(device_), "choosing the device");
    checked(ncclCommInitRank(&ranks_, size, id, rank), "joining the ranks");
  }
  ~NcclCommunicator() override { ncclCommDestroy(ranks_); }

 private:
  void do_shift(const Vector& right, Vector& left) override {
    const bool sends = rank() + 1 < size() && right.size() > 0, receives = rank() > 0 && left.size() > 0;
    double* out = sends ? loaded(right.data(), right.size(), out_) : nullptr;
    double* in = receives ? in_.of(left.size()) : nullptr;
    checked(ncclGroupStart(), "a shift");
    if (sends) checked(ncclSend(out, std::size_t(right.size()), ncclDouble, rank() + 1, ranks_, stream_), "a shift");
    if (receives) checked(ncclRecv(in, std::size_t(left.size()), ncclDouble, rank() - 1, ranks_, stream_), "a shift");
    checked(ncclGroupEnd(), "a shift");
    if (receives)
      fetch(in, left.size(), left.data());
    else
      wait();
  }

  void do_gather(const Vector& values, RowMatrix& all) override {
    if (values.size() == 0) return;
    const double* out = loaded(values.data(), values.size(), out_);
    double* in = in_.of(all.size());
    checked(ncclAllGather(out, in, std::size_t(values.size()), ncclDouble, ranks_, stream_), "a gather");
    fetch(in, all.size(), all.data());
  }

  void do_maximum(Vector& values) override {
    if (values.size() == 0) return;
    double* both = loaded(values.data(), values.size(), out_);
    checked(ncclAllReduce(both, both, std::size_t(values.size()), ncclDouble, ncclMax, ranks_, stream_), "a maximum");
    fetch(both, values.size(), values.data());
  }

  void do_broadcast(double* values, Index count, int root) override {
    for (Index begin = 0; begin < count; begin += most_together) {
      const Index length = std::min(most_together, count - begin);
      double* both = rank() == root ? loaded(values + begin, length, out_) : out_.of(length);
      checked(ncclBroadcast(both, both, std::size_t(length), ncclDouble, root, ranks_, stream_), "a broadcast");
      fetch(both, length, values + begin);
    }
  }

  double* loaded(const double* values, Index count, Buffer& buffer) {
    double* to = buffer.of(count);
    check(cudaMemcpyAsync(to, values, sizeof(double) * std::size_t(count), cudaMemcpyHostToDevice, stream_),
          "copying to the device");
    return to;
  }
  void fetch(const double* from, Index count, double* to) {
    check(cudaMemcpyAsync(to, from, sizeof(double) * std::size_t(count), cudaMemcpyDeviceToHost, stream_),
          "copying from the device");
    wait();
  }
  void wait() const { check(cudaStreamSynchronize(stream_), "waiting for the device"); }

  int device_;
  cudaStream_t stream_;
  ncclComm_t ranks_ = nullptr;
  Buffer out_, in_;
};

// The identity of a device as numbers that every communicator can send.
Vector identity_of(int device) {
  cudaDeviceProp properties;
  check(cudaGetDeviceProperties(&properties, device), "asking the device");
  Vector identity(sizeof properties.uuid.bytes);
  for (Index i = 0; i < identity.size(); ++i) identity[i] = properties.uuid.bytes[i];
  return identity;
}

void refuse_shared_devices(Communicator& job, int device) {
  const RowMatrix all = job.gather(identity_of(device));
  for (Index r = 1; r < all.rows(); ++r)
    for (Index other = 0; other < r; ++other)
      if (all.row(r) == all.row(other))
        throw Error("ranks", "ranks " + std::to_string(other) + " and " + std::to_string(r) + " have the same device",
                    "start one rank for each device");
}

// From rank 0 to all, a byte in each number.
ncclUniqueId identity_of_job(Communicator& job) {
  ncclUniqueId id{};
  if (job.rank() == 0) checked(ncclGetUniqueId(&id), "beginning a job");
  std::array<double, sizeof id.internal> bytes;
  std::copy_n(reinterpret_cast<const unsigned char*>(id.internal), bytes.size(), bytes.begin());
  job.broadcast(bytes.data(), Index(bytes.size()), 0);
  std::transform(bytes.begin(), bytes.end(), reinterpret_cast<unsigned char*>(id.internal),
                 [](double byte) { return static_cast<unsigned char>(byte); });
  return id;
}

}  // namespace

std::unique_ptr<Communicator> make_nccl_communicator(Communicator& job, Backend& cuda) {
  const auto* memory = dynamic_cast<const SharedMemory*>(&cuda);
  if (!memory || memory->place().kind != 2)
    throw Error("NCCL", "found backend '" + cuda.name() + "'", "make the backend of a CUDA device");
  const SharedMemory::Place place = memory->place();
  refuse_shared_devices(job, place.number);
  return std::make_unique<NcclCommunicator>(job.rank(), job.size(), identity_of_job(job), place);
}

}  // namespace bromwich
