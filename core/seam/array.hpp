#pragma once

#include "../base/types.hpp"

#include <cstddef>

namespace bromwich {

/// A space-time array in the memory of a backend: (J+1) x n, row j belongs to time t_j. Zero when made.
class Array {
 public:
  Array(Index rows, Index cols, double* host_values = nullptr) : rows_(rows), cols_(cols), host_values_(host_values) {}
  virtual ~Array() = default;
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;

  Index rows() const { return rows_; }
  Index cols() const { return cols_; }
  /// Row by row, without gaps, where they lie in the memory of the host; null where they do not.
  double* host_values() { return host_values_; }
  const double* host_values() const { return host_values_; }
  std::size_t bytes() const { return sizeof(double) * std::size_t(rows_) * std::size_t(cols_); }

 private:
  Index rows_, cols_;
  double* host_values_;
};

}  // namespace bromwich
