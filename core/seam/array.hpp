#pragma once

#include "../base/types.hpp"

#include <cstddef>

namespace bromwich {

/// A space-time array in the memory of a backend: (J+1) x n, row j belongs to time t_j. Zero when made.
class Array {
 public:
  Array(Index rows, Index cols) : rows_(rows), cols_(cols) {}
  virtual ~Array() = default;
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;

  Index rows() const { return rows_; }
  Index cols() const { return cols_; }
  std::size_t bytes() const { return sizeof(double) * std::size_t(rows_) * std::size_t(cols_); }

 private:
  Index rows_, cols_;
};

}  // namespace bromwich
