#pragma once

#include "../base/types.hpp"

#include <cstddef>

namespace bromwich {

/// Values of a space-time grid in the memory of a backend: row j = time t_j, J+1 rows. Zero when made.
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
