#include "files/hdf5_chunks.hpp"

#include "core/base/error.hpp"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstddef>

namespace bromwich::hdf5 {

namespace {

constexpr Index chunks_of_a_thread = 4;  ///< in memory at once

using Bytes = std::vector<unsigned char>;

/// What the filters shuffle and deflate of the library make of a chunk: the first bytes of all values, the second ones,
/// and so on, compressed.
Bytes filtered(const double* values, Index count) {
  constexpr std::size_t width = sizeof(double);
  const std::size_t n = std::size_t(count);
  const auto* from = reinterpret_cast<const unsigned char*>(values);
  Bytes shuffled(n * width);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t b = 0; b < width; ++b) shuffled[b * n + i] = from[i * width + b];
  uLongf size = compressBound(uLong(shuffled.size()));
  Bytes found(size);
  if (compress2(found.data(), &size, shuffled.data(), uLong(shuffled.size()), int(compression)) != Z_OK)
    throw Error("--out", "could not be compressed", "free some memory", ErrorKind::internal);
  found.resize(size);
  return found;
}

}  // namespace

ChunkedRows::ChunkedRows(File& file, hid_t dataset) : dataset_(dataset) {
  const Shape shape = shape_of(file, dataset);
  Shape chunk(shape.size());
  const Handle creation(file.checked(H5Dget_create_plist(dataset)), H5Pclose);
  file.checked(H5Pget_chunk(creation, int(chunk.size()), chunk.data()));
  chunk_rows_ = Index(chunk[0]);
  for (std::size_t i = 1; i < shape.size(); ++i) width_ *= Index(shape[i]);
  whole_rows_ =
      std::endian::native == std::endian::little && std::equal(chunk.begin() + 1, chunk.end(), shape.begin() + 1);
}

void ChunkedRows::append(File& file, const double* values, Index rows, const HostThreads& threads) {
  if (!whole_rows_) {
    append_rows(file, dataset_, H5T_NATIVE_DOUBLE, written_, rows, values);
    written_ += rows;
    return;
  }
  Index taken = 0;
  if (!waiting_.empty()) {
    taken = std::min(rows, chunk_rows_ - Index(waiting_.size()) / width_);
    waiting_.insert(waiting_.end(), values, values + taken * width_);
    if (Index(waiting_.size()) < chunk_rows_ * width_) return;
    write_chunks(file, waiting_.data(), 1, threads);
    waiting_.clear();
  }
  const Index chunks = (rows - taken) / chunk_rows_;
  write_chunks(file, values + taken * width_, chunks, threads);
  taken += chunks * chunk_rows_;
  waiting_.assign(values + taken * width_, values + rows * width_);
}

void ChunkedRows::finish(File& file) {
  if (waiting_.empty()) return;
  const Index rows = Index(waiting_.size()) / width_;
  append_rows(file, dataset_, H5T_NATIVE_DOUBLE, written_, rows, waiting_.data());
  written_ += rows;
  waiting_.clear();
}

void ChunkedRows::write_chunks(File& file, const double* values, Index chunks, const HostThreads& threads) {
  file.require_whole();
  set_rows(file, dataset_, written_ + chunks * chunk_rows_);
  const Index size = chunk_rows_ * width_, together = chunks_of_a_thread * threads.threads();
  Shape place(shape_of(file, dataset_).size(), 0);
  for (Index first = 0; first < chunks; first += together) {
    std::vector<Bytes> ready(std::size_t(std::min(together, chunks - first)));
    share_each(threads, Index(ready.size()),
               [&](Index i) { ready[std::size_t(i)] = filtered(values + (first + i) * size, size); });
    for (const Bytes& chunk : ready) {
      place[0] = hsize_t(written_);
      file.checked(H5Dwrite_chunk(dataset_, H5P_DEFAULT, 0, place.data(), chunk.size(), chunk.data()));
      written_ += chunk_rows_;
    }
  }
}

}  // namespace bromwich::hdf5
