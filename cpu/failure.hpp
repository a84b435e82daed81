#pragma once

#include <exception>

namespace bromwich::cpu {

/// What was thrown inside a parallel region, memory that ran out for one: no exception may leave the region, so the
/// first one is kept and thrown again behind it.
class Failure {
 public:
  /// In a catch block.
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
