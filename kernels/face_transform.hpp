#pragma once

#include "kernels/device.hpp"

#include <memory>
#include <vector>

namespace bromwich::cuda {

/// The sine transform of grids with 2^k - 1 points, 15 to 511, in both directions.
class FaceKernels {
 public:
  static bool take(const std::vector<Index>& extents);
  FaceKernels(const Device&, const std::vector<Index>& extents);
  ~FaceKernels();

  /// out = add + factor S in for `rows` rows of an array; `factor` is one for each entry of a row, or null. `between`
  /// has the size of `out` and may be `out` unless `add` is.
  void apply(const double* in, const double* add, const double* factor, double* between, double* out, Index rows) const;
  std::size_t bytes() const;

 private:
  struct Tables;
  const Device& device_;
  Index lines_, points_;
  std::unique_ptr<Tables> tables_;
};

}  // namespace bromwich::cuda
