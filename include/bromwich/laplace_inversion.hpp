#pragma once
// The inverse Laplace transform of a function given at complex points,
//
//     f(t) = 1/(2 pi i) ∫_Γ e^{st} F(s) ds,
//
// at many t > 0 over decades: the t of half a decade share one contour.

#include "types.hpp"

#include <functional>
#include <vector>

namespace bromwich {

/// F(s): a row for each s, a column for each component. It is called once with all points.
using LaplaceTransform = std::function<ComplexMatrix(const ComplexVector& s)>;

enum class InversionContour {
  hyperbola,  ///< one for each window of t
  talbot,     ///< a cotangent contour for each t; singularities on a half-line only
};

struct InversionOptions {
  /// F is continued analytically to the plane without the half-lines from these points to the left, s_k - [0, ∞).
  /// Empty: from 0, the negative real axis. Points of one imaginary part share the half-line of the rightmost.
  std::vector<Complex> singularities;
  /// f is real: F(conj s) = conj F(s), and F is called in the upper half-plane only. The conjugates of `singularities`
  /// are meant too.
  bool real = true;
  InversionContour contour = InversionContour::hyperbola;
  double accuracy = 0;  ///< relative, of the values of F; 0: rounding
};

struct LaplaceInverse {
  ComplexMatrix f;  ///< t.size() x components; real entries with InversionOptions::real
  Matrix error;     ///< estimates, the same shape; infinite where F has other singularities than those that were given
  Index evaluations;  ///< points at which F was called
};

/// The error is estimated by a second contour of other parameters, by rounding and by what the contours leave out.
/// These contours, and those of neighbouring windows, must agree to rounding: where they do not, a singularity may lie
/// between them, and the error is infinite from there to larger t (or the disagreement itself, where it is below 1e-6
/// of the terms). So F is examined to the right up to Re s of about 1000 / min t. Throws Error where t is not positive
/// and finite, for singularities that are not finite, and where the singularities need more than 10^5 points.
LaplaceInverse invert_laplace(const LaplaceTransform& F, const Vector& t, const InversionOptions& = {});

}  // namespace bromwich
