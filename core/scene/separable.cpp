#include "core/scene/separable.hpp"

#include "core/base/interruption.hpp"

#include <utility>

namespace bromwich {

SampledSource::SampledSource(RowMatrix amplitudes, Matrix shapes)
    : amplitudes_(std::move(amplitudes)), shapes_(std::move(shapes)) {}

std::size_t SampledSource::bytes() const {
  return sizeof(double) * std::size_t(amplitudes_.size() + shapes_.size() + table_.size());
}

Vector SampledSource::row(Index j) const {
  if (factored()) return shapes_ * amplitudes_.row(j).transpose();
  return table_.row(j).transpose();
}

SampledSource SampledSource::rows(Index first, Index count, Index step) const {
  const auto chosen = Eigen::seqN(first, count, step);
  if (factored()) return {amplitudes_(chosen, Eigen::all), shapes_};
  return SampledSource(table_(chosen, Eigen::all));
}

SampledSource SampledSource::plus(const Vector& shift) const {
  if (!factored()) return SampledSource(table_.rowwise() + shift.transpose());
  RowMatrix a(rows(), amplitudes_.cols() + 1);
  a << amplitudes_, Vector::Ones(rows());
  Matrix V(cols(), shapes_.cols() + 1);
  V << shapes_, shift;
  return {std::move(a), std::move(V)};
}

Index SampledSource::not_finite() const {
  // Products of V and a stay finite where their sizes allow for it.
  const auto size = [](const auto& m) {
    return m.size() > 0 ? m.cwiseAbs().template maxCoeff<Eigen::PropagateNaN>() : 0;
  };
  if (factored() && size(amplitudes_) < 1e150 && size(shapes_) < 1e150) return -1;
  for (Index j = 0; j < rows(); ++j)
    if (factored() ? !row(j).allFinite() : (0 * table_.row(j).array()).sum() != 0) return j;  // NaN is not 0 either
  return -1;
}

void SampledSource::replace(Index j, const Vector& value) {
  if (factored()) table_.resize(0, 0);
  (factored() ? amplitudes_ : table_).row(j) = value.transpose();
}

const RowMatrix& SampledSource::table() const {
  if (factored() && table_.size() == 0) table_.noalias() = amplitudes_ * shapes_.transpose();
  return table_;
}

constexpr Index polled_rows = 32;

Vector time_grid(double T, Index J) {
  Vector t(J + 1);
  for (Index j = 0; j <= J; ++j) t[j] = T * double(j) / double(J);
  return t;
}

SampledSource sample(const TimeFunction& function, const Vector& t, Index width) {
  if (!function) return SampledSource(RowMatrix::Zero(t.size(), width));
  const auto* separable = function.separable();
  if (separable && separable->shapes.cols() == 0) return sample(nullptr, t, width);
  RowMatrix values(t.size(), separable ? separable->shapes.cols() : width);
  Vector value(values.cols());
  for (Index j = 0; j < t.size(); ++j) {
    if (j % polled_rows == 0) check_interruption();
    value.setZero();
    separable ? separable->time(t[j], value) : function(t[j], value);
    values.row(j) = value.transpose();
  }
  if (separable) return {std::move(values), separable->shapes};
  return SampledSource(std::move(values));
}

}  // namespace bromwich
