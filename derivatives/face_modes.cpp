#include "derivatives/face_modes.hpp"

#include "core/base/simd.hpp"

#include <algorithm>
#include <type_traits>

namespace bromwich {

using simd::Lanes;

namespace {

constexpr Index together = 4;        ///< sums that do not wait for one another
constexpr Index rows_together = 64;  ///< of a transform: blocks that the cache holds

double sum_of(Lanes v) { return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7])); }

}  // namespace

FaceModes::FaceModes(FaceBasis basis)
    : basis_(std::move(basis)), n_(basis_.points()), width_(simd::blocks(n_) * simd::lanes) {
  if (basis_.size() != 1) return;
  const Matrix V = basis_.matrix();
  columns_ = RowMatrix::Zero(n_, width_);
  columns_.leftCols(n_) = V;
  if (!basis_.is_sine()) return;
  const Index half = n_ / 2, first = n_ - half;
  even_ = V(Eigen::seqN(0, first), Eigen::seqN(0, first, 2));
  odd_ = V(Eigen::seqN(0, half), Eigen::seqN(1, half, 2));
}

void FaceModes::transform(Way way, Eigen::Ref<RowMatrix> values) const {
  if (basis_.size() != 1) {
    for (Index j = 0; j < values.rows(); ++j) basis_.apply(way, values.row(j).data());
    return;
  }
  if (basis_.is_sine()) return fold(values);
  const auto V = columns_.leftCols(n_);
  RowMatrix products(std::min(rows_together, values.rows()), n_);
  for (Index j = 0; j < values.rows(); j += rows_together) {
    const Index count = std::min(rows_together, values.rows() - j);
    auto rows = values.middleRows(j, count);
    if (way == Way::to_modes)
      products.topRows(count).noalias() = rows * V;
    else
      products.topRows(count).noalias() = rows * V.transpose();
    rows = products.topRows(count);
  }
}

// In place, some rows at a time: large arrays that are made for a moment cost more than the products, in page faults.
void FaceModes::fold(Eigen::Ref<RowMatrix> values) const {
  const Index half = n_ / 2, first = n_ - half;
  const Index most = std::min(rows_together, values.rows());
  RowMatrix sums(most, first), differences(most, half), modes(most, first);
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

void FaceModes::seen_on(const std::vector<Index>& set, const double* modes, Vector& values) const {
  if (basis_.size() != 1) {
    values = Eigen::Map<const Vector>(modes, n_);
    return basis_.apply(Way::to_points, values.data());
  }
  const std::size_t size = set.size();
  for (std::size_t i = 0; i < size; i += together) {
    const double* column[together];
    for (Index c = 0; c < together; ++c) column[c] = columns_.row(set[std::min(i + std::size_t(c), size - 1)]).data();
    Lanes sums[together] = {};
    for (Index l = 0; l < width_; l += simd::lanes) {
      const Lanes mode = simd::load(modes + l);
      for (Index c = 0; c < together; ++c) sums[c] += simd::load(column[c] + l) * mode;
    }
    for (std::size_t c = 0; c < together && i + c < size; ++c) values[set[i + c]] = sum_of(sums[c]);
  }
}

void FaceModes::of_set(const std::vector<Index>& set, const Vector& values, double* modes) const {
  if (basis_.size() != 1) {
    Eigen::Map<Vector> all(modes, width_);
    all.head(n_) = values;
    all.tail(width_ - n_).setZero();
    return basis_.apply(Way::to_modes, modes);
  }
  Index l = 0;
  const auto sum_blocks = [&]<Index blocks>(std::integral_constant<Index, blocks>) {
    Lanes sums[blocks] = {};
    for (const Index i : set) {
      const double* column = columns_.row(i).data() + l;
      for (Index c = 0; c < blocks; ++c) sums[c] += simd::all(values[i]) * simd::load(column + c * simd::lanes);
    }
    for (Index c = 0; c < blocks; ++c) simd::store(modes + l + c * simd::lanes, sums[c]);
    l += blocks * simd::lanes;
  };
  while (l + together * simd::lanes <= width_) sum_blocks(std::integral_constant<Index, together>());
  while (l < width_) sum_blocks(std::integral_constant<Index, 1>());
}

}  // namespace bromwich
