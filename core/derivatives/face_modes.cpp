#include "core/derivatives/face_modes.hpp"

#include "core/base/simd.hpp"

#include <algorithm>
#include <type_traits>

namespace bromwich {

using simd::Lanes;

namespace {

constexpr Index together = 4;        ///< sums that do not wait for one another
constexpr Index rows_together = 64;  ///< of a transform: blocks that the cache holds

double sum_of(Lanes v) {
  double sum = 0;
  for (Index i = 0; i < simd::lanes; ++i) sum += v[i];
  return sum;
}

}  // namespace

FaceModes::FaceModes(FaceBasis basis) : basis_(std::move(basis)), n_(basis_.points()) {
  if (basis_.size() != 1) return;
  const Matrix V = basis_.matrix();
  columns_ = RowMatrix::Zero(n_, simd::blocks(n_) * simd::lanes);
  columns_.leftCols(n_) = V;
  if (!basis_.is_sine()) return;
  const Index half = n_ / 2, first = n_ - half;
  even_ = V(Eigen::seqN(0, first), Eigen::seqN(0, first, 2));
  odd_ = V(Eigen::seqN(0, half), Eigen::seqN(1, half, 2));
}

RowMatrix FaceModes::transformed(RowMatrix values, Way way) const {
  if (basis_.size() != 1) {
    for (Index j = 0; j < values.rows(); ++j) basis_.apply(way, values.row(j).data());
    return values;
  }
  if (basis_.is_sine()) {
    fold(values);
    return values;
  }
  const auto V = columns_.leftCols(n_);
  RowMatrix products(rows_together, n_);
  for (Index j = 0; j < values.rows(); j += rows_together) {
    const Index count = std::min(rows_together, values.rows() - j);
    auto rows = values.middleRows(j, count);
    if (way == Way::to_modes)
      products.topRows(count).noalias() = rows * V;
    else
      products.topRows(count).noalias() = rows * V.transpose();
    rows = products.topRows(count);
  }
  return values;
}

// In place, some rows at a time: large arrays that are made for a moment cost more than the products, in page faults.
void FaceModes::fold(RowMatrix& values) const {
  const Index half = n_ / 2, first = n_ - half;
  RowMatrix sums(rows_together, first), differences(rows_together, half), modes(rows_together, first);
  for (Index j = 0; j < values.rows(); j += rows_together) {
    const Index count = std::min(rows_together, values.rows() - j);
    auto rows = values.middleRows(j, count);
    const auto mirrored = rows.rightCols(half).rowwise().reverse();
    sums.topRows(count) = rows.leftCols(first);
    sums.topLeftCorner(count, half) += mirrored;
    differences.topRows(count) = rows.leftCols(half) - mirrored;
    modes.topRows(count).noalias() = sums.topRows(count) * even_;
    rows(Eigen::all, Eigen::seqN(0, first, 2)) = modes.topRows(count);
    modes.topLeftCorner(count, half).noalias() = differences.topRows(count) * odd_;
    rows(Eigen::all, Eigen::seqN(1, half, 2)) = modes.topLeftCorner(count, half);
  }
}

void FaceModes::seen_on(const std::vector<Index>& set, const Vector& modes, Vector& values) const {
  if (basis_.size() != 1) {
    values = modes;
    return basis_.apply(Way::to_points, values.data());
  }
  Vector whole = Vector::Zero(columns_.cols());
  whole.head(n_) = modes;
  const std::size_t size = set.size();
  for (std::size_t i = 0; i < size; i += together) {
    const double* column[together];
    for (Index c = 0; c < together; ++c) column[c] = columns_.row(set[std::min(i + std::size_t(c), size - 1)]).data();
    Lanes sums[together] = {};
    for (Index l = 0; l < whole.size(); l += simd::lanes) {
      const Lanes mode = simd::load(&whole[l]);
      for (Index c = 0; c < together; ++c) sums[c] += simd::load(column[c] + l) * mode;
    }
    for (std::size_t c = 0; c < together && i + c < size; ++c) values[set[i + c]] = sum_of(sums[c]);
  }
}

void FaceModes::of_set(const std::vector<Index>& set, const Vector& values, Vector& modes) const {
  if (basis_.size() != 1) {
    modes = values;
    return basis_.apply(Way::to_modes, modes.data());
  }
  const Index width = columns_.cols();
  Vector whole(width);
  Index l = 0;
  const auto sum_blocks = [&]<Index blocks>(std::integral_constant<Index, blocks>) {
    Lanes sums[blocks] = {};
    for (const Index i : set) {
      const double* column = columns_.row(i).data() + l;
      for (Index c = 0; c < blocks; ++c) sums[c] += simd::all(values[i]) * simd::load(column + c * simd::lanes);
    }
    for (Index c = 0; c < blocks; ++c) simd::store(&whole[l + c * simd::lanes], sums[c]);
    l += blocks * simd::lanes;
  };
  while (l + together * simd::lanes <= width) sum_blocks(std::integral_constant<Index, together>());
  while (l < width) sum_blocks(std::integral_constant<Index, 1>());
  modes = whole.head(n_);
}

}  // namespace bromwich
