// Operations on rows of arrays (core/seam/slab_operations.hpp), for a rank that has a slab of the time points.

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

namespace bromwich::cuda {

namespace {

constexpr int threads = 256;
constexpr const char* moving = "moving rows of arrays";

/// Bytes between the rows of an array, which have their padding with them.
std::size_t pitch(const Array& array) { return sizeof(double) * std::size_t(stride(array.cols())); }
double* row(Array& array, Index j) { return values(array) + j * stride(array.cols()); }
const double* row(const Array& array, Index j) { return values(array) + j * stride(array.cols()); }

// Row i of `fine`, blockIdx.x, is row first + i of a grid with `ratio` times the steps of `coarse`.
__global__ void add_interpolated(const double* coarse, const double* old, int ratio, int first, int step,
                                 double* fine) {
  let_next_begin();
  await_previous();
  const int column = int(blockIdx.y * blockDim.x + threadIdx.x), j = first + int(blockIdx.x), left = j / ratio;
  if (column >= step) return;
  const double share = double(j % ratio) / double(ratio);
  const auto change = [&](int at) {
    const long place = long(at) * step + column;
    return coarse[place] - (old ? old[place] : 0);
  };
  double sum = (1 - share) * change(left);
  if (share > 0) sum += share * change(left + 1);
  fine[long(blockIdx.x) * step + column] += sum;
}

}  // namespace

void move_rows(const Device& device, const Array* from, Index first, Index ratio, Array& to, Index begin, Index count) {
  if (count <= 0) return;
  const std::size_t width = pitch(to), rows = std::size_t(count);
  device.note_work();
  if (!from)
    check(cudaMemsetAsync(row(to, begin), 0, width * rows, device.stream()), moving);
  else
    check(cudaMemcpy2DAsync(row(to, begin), width, row(*from, first), width * std::size_t(ratio), width, rows,
                            cudaMemcpyDeviceToDevice, device.stream()),
          moving);
}

void download_rows(const Device& device, const Array& from, Index first, Index count, double* to) {
  if (count <= 0) return;
  device.fetcher().fetch(row(from, first), std::size_t(stride(from.cols())), to, std::size_t(from.cols()),
                         std::size_t(count), device.stream(), [] {});
}

void upload_rows(const Device& device, const double* from, Array& to, Index first, Index count) {
  if (count <= 0) return;
  const std::size_t width = sizeof(double) * std::size_t(to.cols());
  check(cudaMemcpy2DAsync(row(to, first), pitch(to), from, width, width, std::size_t(count), cudaMemcpyHostToDevice,
                          device.stream()),
        moving);
  device.wait();
}

void interpolate_rows(const Device& device, const Array& coarse, const Array* old, Index ratio, Index first,
                      Array& fine) {
  const Index step = stride(fine.cols());
  follow(device, add_interpolated, {dim3(unsigned(fine.rows()), unsigned((step + threads - 1) / threads)), threads},
         "starting an interpolation", values(coarse), old ? values(*old) : nullptr, int(ratio), int(first), int(step),
         values(fine));
}

}  // namespace bromwich::cuda
