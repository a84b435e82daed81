#pragma once

namespace bromwich {

/// A contour has to enclose the eigenvalues, which lie in the sector |arg(abscissa - z)| <= half_angle.
struct SpectralBound {
  double half_angle = 0;  ///< radians, 0: real eigenvalues
  double abscissa = 0;    ///< largest real part
};

}  // namespace bromwich
