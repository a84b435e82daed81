#pragma once

#include "kernels/device.hpp"

#include <memory>
#include <vector>

namespace bromwich::cuda {

/// The sine transform of grids with 127, 255 or 511 points in both directions, for many grids at a time.
class FaceHalves {
 public:
  static bool take(const std::vector<Index>& extents);
  FaceHalves(const Device&, const std::vector<Index>& extents);
  ~FaceHalves();

  /// Whether so many grids fill the device; fewer wait for each other less in FaceKernels.
  bool suits(Index rows) const;
  /// As FaceKernels::apply.
  void apply(const double* in, const double* add, const double* factor, double* between, double* out, Index rows) const;
  std::size_t bytes() const;

 private:
  struct Tables;
  const Device& device_;
  Index lines_, points_;
  std::unique_ptr<Tables> tables_;
};

}  // namespace bromwich::cuda
