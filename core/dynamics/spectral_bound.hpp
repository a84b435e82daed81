#pragma once

namespace bromwich {

/// What a contour has to go around: the eigenvalues lie in the sector |arg(abscissa - z)| <= half_angle.
struct SpectralBound {
  double half_angle = 0;  ///< radians, 0: real eigenvalues
  double abscissa = 0;    ///< largest real part
};

}  // namespace bromwich
