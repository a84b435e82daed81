#pragma once

#include <exception>

namespace bromwich::cpu {

/// Keeps the first exception thrown inside an OpenMP region (out of memory, for example) and rethrows it afterwards: no
/// exception may leave the region.
class Failure {
 public:
  /// Call inside a catch block.
  void keep() noexcept {
#pragma omp critical(bromwich_failure)
    if (!first_) first_ = std::current_exception();
  }
  void rethrow() const {
    if (first_) std::rethrow_exception(first_);
  }

 private:
  std::exception_ptr first_;
};

}  // namespace bromwich::cpu
