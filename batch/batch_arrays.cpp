#include "batch/batch_arrays.hpp"

namespace bromwich {

BatchArrays::BatchArrays(Backend& backend, Index scenes, Index rows, Index n, Index m)
    : backend_(backend),
      rows_(rows),
      y_(backend.array(scenes * rows, n)),
      x_(m > 0 ? backend.array(scenes * rows, m) : nullptr),
      taken_(std::size_t(scenes), 0) {}

void BatchArrays::take(const Array& y, const Array* x, Index i, Index k, Index count) {
  const auto& move_rows = backend_.fused().slabs.move_rows;
  move_rows(&y, i * rows_, 1, *y_, k * rows_, count * rows_);
  if (x_) move_rows(x, i * rows_, 1, *x_, k * rows_, count * rows_);
  for (Index j = k; j < k + count; ++j) taken_[std::size_t(j)] = 1;
}

void BatchArrays::take_others(const RowMatrix& y, const RowMatrix& x) {
  const auto& upload_rows = backend_.fused().slabs.upload_rows;
  const Index scenes = Index(taken_.size());
  for (Index k = 0, end = 0; k < scenes; k = end + 1) {
    for (end = k; end < scenes && !has(end);) ++end;
    if (end == k) continue;
    const Index first = k * rows_, count = (end - k) * rows_;
    upload_rows(y.row(first).data(), *y_, first, count);
    if (x_) upload_rows(x.row(first).data(), *x_, first, count);
  }
  backend_.wait();
}

}  // namespace bromwich
