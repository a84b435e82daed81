#include "ranks/slab_array.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr Index values_of_a_piece = Index(1) << 25;  ///< 256 MiB, in which results travel

}  // namespace

HostRows::HostRows(Backend& local, Array& array)
    : local_(local), array_(array), values_(array.host_values()), cols_(array.cols()), stride_(cols_) {
  if (values_) return;
  local.download(array, copy_);
  values_ = copy_.data();
}

void HostRows::put() {
  if (copy_.size() > 0) local_.upload(copy_, array_);
}

RowMatrix RankedBackend::rows_here(const Array& array, Index first, Index count) const {
  RowMatrix values(count, array.cols());
  if (const double* host = array.host_values()) {
    values = Eigen::Map<const RowMatrix>(host + first * array.cols(), count, array.cols());
  } else if (const SlabOperations& rows = local.fused().slabs) {
    rows.download_rows(array, first, count, values.data());
  } else {
    RowMatrix all;
    local.download(array, all);
    values = all.middleRows(first, count);
  }
  return values;
}

void RankedBackend::put_rows_here(const RowMatrix& values, Array& array, Index first) const {
  if (double* host = array.host_values()) {
    Eigen::Map<RowMatrix>(host + first * array.cols(), values.rows(), array.cols()) = values;
  } else if (const SlabOperations& rows = local.fused().slabs) {
    rows.upload_rows(values.data(), array, first, values.rows());
  } else if (first == 0) {
    local.upload(values, array);
  } else {
    RowMatrix all;
    local.download(array, all);
    all.middleRows(first, values.rows()) = values;
    local.upload(all, array);
  }
}

void RankedBackend::shift(const std::vector<RowShift>& rows) const {
  if (communicator.moves_rows()) return communicator.shift(rows);
  Index size = 0;
  for (const RowShift& one : rows) size += one.count * one.from->cols();
  Vector right(size), left = Vector::Zero(size);
  Index at = 0;
  for (const RowShift& one : rows) {
    const Index values = one.count * one.from->cols();
    if (!last())
      Eigen::Map<RowMatrix>(right.data() + at, one.count, one.from->cols()) =
          rows_here(*one.from, one.from_row, one.count);
    at += values;
  }
  communicator.shift(right, left);
  at = 0;
  for (const RowShift& one : rows) {
    const Index values = one.count * one.from->cols();
    if (!first())
      put_rows_here(Eigen::Map<const RowMatrix>(left.data() + at, one.count, one.from->cols()), *one.to, one.to_row);
    at += values;
  }
}

void RankedBackend::gather(const Array& values, Array& all) const {
  if (communicator.moves_rows()) return communicator.gather(values, all);
  put_rows_here(communicator.gather(Vector(rows_here(values, 0, 1).transpose())), all, 0);
}

void RankedBackend::copy_row_before(std::initializer_list<const Array*> arrays) const {
  std::vector<RowShift> rows;
  for (const Array* array : arrays)
    rows.push_back({&local_part(*array), slab(*array).slabs.rows() - 1, &local_part(*array), 0, 1});
  shift(rows);
}

void RankedBackend::clear_row_before(const Array& array) const {
  if (slab(array).slabs.own() == 0) return;
  if (const SlabOperations& rows = local.fused().slabs) return rows.move_rows(nullptr, 0, 1, local_part(array), 0, 1);
  local.upload(RowMatrix::Zero(1, array.cols()), local_part(array));
}

void RankedBackend::download(const Array& from, RowMatrix& to) const {
  if (slab(from).slabs.whole()) return local.download(local_part(from), to);
  if (communicator.moves_rows()) return download_from_devices(from, to);
  to = every(from, 1);
}

// Own rows from the own device, those of others in pieces by way of it.
void RankedBackend::download_from_devices(const Array& from, RowMatrix& to) const {
  const SlabOperations& rows = local.fused().slabs;
  const Slabs& slabs = slab(from).slabs;
  const Index cols = from.cols(), most = std::max<Index>(1, values_of_a_piece / std::max<Index>(1, cols));
  const auto piece = local.array(std::min(most, from.rows()), cols);
  to.resize(from.rows(), cols);
  for (int r = 0; r < communicator.size(); ++r) {
    const Index begin = r == 0 ? 0 : slabs.begin(r) + 1, end = slabs.begin(r) + slabs.count(r) + 1;
    for (Index row = begin; row < end; row += most) {
      const Index count = std::min(most, end - row);
      const bool own = r == communicator.rank();
      if (own) rows.move_rows(&local_part(from), row - slabs.first(), 1, *piece, 0, count);
      std::vector<Index> ends(std::size_t(communicator.size()) + 1, 0);  // rank r has all of the piece
      std::fill(ends.begin() + r + 1, ends.end(), count);
      communicator.gather(*piece, ends);
      rows.download_rows(*piece, 0, count, to.row(row).data());
    }
  }
}

void RankedBackend::collect(const Array& from, Index ratio, Array& whole) const {
  const SlabOperations& rows = local.fused().slabs;
  if (!rows || !communicator.moves_rows()) return upload(every(from, ratio), whole);
  const Slabs& slabs = slab(from).slabs;
  const auto first_of = [&](int r) { return r == 0 ? 0 : slabs.begin(r) / ratio + 1; };
  const Index mine = first_of(slabs.rank), count = first_of(slabs.rank + 1) - mine;
  Array& to = local_part(whole);
  rows.move_rows(&local_part(from), mine * ratio - slabs.first(), ratio, to, mine, count);
  std::vector<Index> ends;
  for (int r = 0; r <= communicator.size(); ++r) ends.push_back(first_of(r));
  communicator.gather(to, ends);
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
