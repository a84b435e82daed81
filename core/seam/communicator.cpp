#include "core/seam/communicator.hpp"

#include <cmath>
#include <limits>

namespace bromwich {

void Communicator::shift(const Vector& right, Vector& left) {
  if (rank() + 1 < size()) sent_.shifted += sizeof(double) * std::size_t(right.size());
  do_shift(right, left);
}

RowMatrix Communicator::gather(const Vector& values) {
  RowMatrix all(size(), values.size());
  sent_.gathered += sizeof(double) * std::size_t(values.size() * (size() - 1));
  do_gather(values, all);
  return all;
}

// A maximum may drop a NaN: a second half says where they are.
void Communicator::maximum(Vector& values) {
  const Index count = values.size();
  Vector both(2 * count);
  for (Index i = 0; i < count; ++i) {
    both[i] = std::isnan(values[i]) ? 0 : values[i];
    both[count + i] = std::isnan(values[i]) ? 1 : 0;
  }
  if (size() > 1) sent_.compared += sizeof(double) * std::size_t(2 * count);
  do_maximum(both);
  for (Index i = 0; i < count; ++i)
    values[i] = both[count + i] > 0 ? std::numeric_limits<double>::quiet_NaN() : both[i];
}

void Communicator::broadcast(double* values, Index count, int root) {
  if (rank() == root) sent_.broadcast += sizeof(double) * std::size_t(count * (size() - 1));
  do_broadcast(values, count, root);
}

void Communicator::shift(const std::vector<RowShift>& rows) {
  for (const RowShift& one : rows)
    if (rank() + 1 < size()) sent_.shifted += sizeof(double) * std::size_t(one.count * one.from->cols());
  do_shift_rows(rows);
}

void Communicator::gather(const Array& values, Array& all) {
  sent_.gathered += values.bytes() * std::size_t(size() - 1);
  do_gather_rows(values, all);
}

void Communicator::gather(Array& rows, const std::vector<Index>& ends) {
  const auto mine = std::size_t(rank());
  sent_.broadcast += sizeof(double) * std::size_t((ends[mine + 1] - ends[mine]) * rows.cols() * (size() - 1));
  do_gather_rows(rows, ends);
}

}  // namespace bromwich
