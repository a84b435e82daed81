#include "kernels/nccl_communicator.hpp"

#include "core/base/error.hpp"
#include "kernels/device.hpp"

#include <nccl.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace bromwich {

namespace {

void checked(ncclResult_t status, const char* what) {
  if (status == ncclSuccess) return;
  throw Error("NCCL", std::string(what) + " failed: " + ncclGetErrorString(status),
              "see what NCCL_DEBUG=INFO says, or run it on one rank", ErrorKind::device);
}

const char* const shifting = "a shift";

// Without the rest of kernels/: this file is in a shared object of its own.
void check(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return;
  throw Error("cuda", std::string(what) + " failed: " + cudaGetErrorString(status), "see what nvidia-smi says",
              ErrorKind::device);
}

class NcclCommunicator final : public Communicator {
 public:
  NcclCommunicator(Communicator& job, const ncclUniqueId& id, const SharedMemory::Place& place)
      : Communicator(job.rank(), job.size()), job_(job), stream_(reinterpret_cast<cudaStream_t>(place.stream)) {
    check(cudaSetDevice(place.number), "choosing the device");
    checked(ncclCommInitRank(&ranks_, size(), id, rank()), "joining the ranks");
  }
  ~NcclCommunicator() override { ncclCommDestroy(ranks_); }

  // Shorter grids do not fill a device.
  Index fewest_steps() const override { return 64; }
  bool moves_rows() const override { return true; }

 private:
  void do_shift(const Vector& right, Vector& left) override { job_.shift(right, left); }
  void do_gather(const Vector& values, RowMatrix& all) override { all = job_.gather(values); }
  void do_maximum(Vector& values) override { job_.maximum(values); }
  void do_broadcast(double* values, Index count, int root) override { job_.broadcast(values, count, root); }

  void do_shift_rows(const std::vector<RowShift>& rows) override {
    checked(ncclGroupStart(), shifting);
    for (const RowShift& one : rows) {
      const std::size_t count = values_of(*one.from, one.count);
      if (rank() + 1 < size())
        checked(ncclSend(row(*one.from, one.from_row), count, ncclDouble, rank() + 1, ranks_, stream_), shifting);
      if (rank() > 0)
        checked(ncclRecv(row(*one.to, one.to_row), count, ncclDouble, rank() - 1, ranks_, stream_), shifting);
    }
    checked(ncclGroupEnd(), shifting);
  }

  void do_gather_rows(const Array& values, Array& all) override {
    checked(ncclAllGather(row(values, 0), row(all, 0), values_of(values, 1), ncclDouble, ranks_, stream_), "a gather");
  }

  // Each rank to each other one: all links work at the same time, in one kernel.
  void do_gather_rows(Array& rows, const std::vector<Index>& ends) override {
    const auto count = [&](int r) { return values_of(rows, ends[std::size_t(r) + 1] - ends[std::size_t(r)]); };
    checked(ncclGroupStart(), "a gather");
    for (int r = 0; r < size(); ++r) {
      if (r == rank()) continue;
      if (count(rank()) > 0)
        checked(ncclSend(row(rows, ends[std::size_t(rank())]), count(rank()), ncclDouble, r, ranks_, stream_),
                "a gather");
      if (count(r) > 0)
        checked(ncclRecv(row(rows, ends[std::size_t(r)]), count(r), ncclDouble, r, ranks_, stream_), "a gather");
    }
    checked(ncclGroupEnd(), "a gather");
  }

  // Rows have their padding with them.
  static std::size_t values_of(const Array& array, Index rows) {
    return std::size_t(rows * cuda::stride(array.cols()));
  }
  static const double* row(const Array& array, Index j) { return cuda::values(array) + j * cuda::stride(array.cols()); }
  static double* row(Array& array, Index j) { return cuda::values(array) + j * cuda::stride(array.cols()); }

  Communicator& job_;
  cudaStream_t stream_;
  ncclComm_t ranks_ = nullptr;
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

std::unique_ptr<Communicator> make_nccl_communicator(Communicator& job, const SharedMemory::Place& place) {
  if (place.kind != 2) throw Error("NCCL", "found a backend without a CUDA device", "use the backend of a CUDA device");
  refuse_shared_devices(job, place.number);
  return std::make_unique<NcclCommunicator>(job, identity_of_job(job), place);
}

}  // namespace bromwich
