#include "core/slabs/slab_array.hpp"

#include <algorithm>

namespace bromwich {

HostRows::HostRows(Backend& local, Array& array)
    : local_(local), array_(array), values_(array.host_values()), cols_(array.cols()) {
  if (values_) return;
  local.download(array, copy_);
  values_ = copy_.data();
}

void HostRows::put() {
  if (copy_.size() > 0) local_.upload(copy_, array_);
}

void RankedBackend::copy_row_before(std::initializer_list<const Array*> arrays) const {
  Index cols = 0;
  for (const Array* array : arrays) cols += array->cols();
  Vector right(cols), left = Vector::Zero(cols);
  Index at = 0;
  for (const Array* array : arrays) {
    const Index n = array->cols();
    if (!last())
      right.segment(at, n) =
          Eigen::Map<Vector>(HostRows(local, local_part(*array)).row(slab(*array).slabs.rows() - 1), n);
    at += n;
  }
  communicator.shift(right, left);
  at = 0;
  for (const Array* array : arrays) {
    const Index n = array->cols();
    if (!first()) local.upload(RowMatrix(left.segment(at, n).transpose()), local_part(*array));
    at += n;
  }
}

void RankedBackend::clear_row_before(const Array& array) const {
  if (slab(array).slabs.own() > 0) local.upload(RowMatrix::Zero(1, array.cols()), local_part(array));
}

void RankedBackend::download(const Array& from, RowMatrix& to) const {
  if (slab(from).slabs.whole()) return local.download(local_part(from), to);
  to = every(from, 1);
}

RowMatrix RankedBackend::every(const Array& from, Index ratio) const {
  const Slabs& slabs = slab(from).slabs;
  RowMatrix rows(slabs.steps / ratio + 1, from.cols());
  const auto first_of = [&](int r) { return r == 0 ? 0 : slabs.begin(r) / ratio + 1; };
  {
    HostRows mine(local, local_part(from));
    for (Index i = first_of(slabs.rank); i < first_of(slabs.rank + 1); ++i)
      rows.row(i) = Eigen::Map<const Eigen::RowVectorXd>(mine.row(i * ratio - slabs.first()), from.cols());
  }
  for (int r = 0; r < communicator.size(); ++r) {
    const Index begin = first_of(r), count = first_of(r + 1) - begin;
    communicator.broadcast(rows.row(begin).data(), count * from.cols(), r);
  }
  return rows;
}

void RankedBackend::upload(const RowMatrix& from, Array& to) const {
  const Slabs& slabs = slab(to).slabs;
  if (slabs.whole()) return local.upload(from, local_part(to));
  const Index count = std::min(from.rows() - slabs.first(), slabs.rows());
  if (count > 0) local.upload(from.middleRows(slabs.first(), count), local_part(to));
}

}  // namespace bromwich
