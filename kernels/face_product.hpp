#pragma once

#include "kernels/device.hpp"

#include <vector>

namespace bromwich::cuda {

/// The sine transform of many faces of 127 x 127 points by tensor cores (compute capability 9.0).
class FaceProducts {
 public:
  static bool take(const Device&, const std::vector<Index>& extents);
  explicit FaceProducts(const Device&);

  /// out = S in for `faces` rows of an array.
  void apply(const double* in, double* out, Index faces) const;
  std::size_t bytes() const { return tables_.bytes(); }

 private:
  const Device& device_;
  Memory<double> tables_;
};

}  // namespace bromwich::cuda
