#pragma once
// Memory that a backend shares with other programs (DLPack). A backend whose arrays lie in such memory is derived from
// this class, too.

#include "../lcp/matrix.hpp"
#include "array.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>

namespace bromwich {

class SharedMemory {
 public:
  /// As DLPack names it.
  struct Place {
    int kind = 1;               ///< 1: memory of the host, 2: of a CUDA device
    int number = 0;             ///< of the device
    std::uintptr_t stream = 0;  ///< on which the backend works; 0: none
  };

  virtual ~SharedMemory() = default;
  virtual Place place() const = 0;

  /// `values` numbers in the memory of the backend, one after the other, not initialised. Must not outlive it.
  virtual std::shared_ptr<double> numbers(Index values) = 0;
  /// to <- rows of to.cols() numbers each, one after the other. Takes effect in the order of the calls.
  virtual void read(const double* from, Array& to) = 0;
  virtual void write(const Array& from, double* to) = 0;
  /// Waits.
  virtual void to_host(const void* from, std::size_t bytes, void* to) = 0;
  /// q <- q + M y, row by row.
  virtual void add_product(const LcpMatrix& M, const Array& y, Array& q) = 0;
};

}  // namespace bromwich
