#pragma once

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// What a Convolution by a modal recurrence is derived from too, if its state can begin with given values. Then
/// apply(y, v, first) keeps what was added to rows of v before `first` in the modes that leave z out.
class CarriedConvolution {
 public:
  virtual ~CarriedConvolution() = default;
  /// From now on z_0 = G0 y_0 + z in the modes for which this returns true, z: K x n values. The others leave z out.
  virtual const std::vector<bool>& begin_with(const Vector& z) = 0;
};

}  // namespace bromwich
