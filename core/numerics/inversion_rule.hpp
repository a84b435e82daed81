#pragma once
// Quadrature rules for the inverse Laplace transform at all t of a window [t0, t1],
//
//     f(t) ≈ Σ_p w_p e^{s_p t} F(s_p),
//
// on hyperbolas s = c + m/t1 (1 + sin(iv - alpha)) around the half-lines to which the singularities of F belong
// (Weideman, Trefethen, Math. Comp. 76, 2007; Weideman, SIAM J. Numer. Anal. 44, 2006).
//
// symbol  variable       meaning
// c       centre         rightmost real part, middle of the imaginary parts
// omega   half_height    half the distance of the outer half-lines that share a hyperbola
// L       digits         errors of the rule are e^{-L} of the integrand near the contour
// R       growth         largest e^{(s - c) t} on the contour is e^R: rounding grows by it
//
// A hyperbola of another alpha lies to the left (larger) or to the right (smaller). The trapezoidal rule of step h has
// errors e^{-2 pi d/h} times the size of the integrand on the hyperbola of alpha ± d: on the left the one through the
// outer half-lines' ends (or at 1/t1 from them), on the right the vertical line alpha = 0, where it is e^{m}. Nodes end
// where e^{(s - c) t0} is e^{-L}. alpha and m of the fewest nodes are searched.

#include "bromwich/laplace_inversion.hpp"

#include <optional>

namespace bromwich {

struct InversionAccuracy {
  double digits = 34, growth = 4;
};

/// Nodes on all hyperbolas of a rule.
struct InversionRule {
  double t0 = 0, t1 = 0;
  ComplexVector centre, offset;  ///< s_p = centre_p + offset_p
  ComplexVector weight;          ///< for a real f it is Re Σ_p weight_p e^{s_p t} F(s_p), upper halves alone
  Vector outermost;              ///< 1 at the ends of a hyperbola, 0 elsewhere

  Index size() const { return weight.size(); }
  ComplexVector points() const { return centre + offset; }  ///< s_p
};

/// Parameters of a hyperbola in units of 1/t1.
struct InversionHyperbola {
  double scale, alpha, spacing;  ///< m, alpha, h
  Index nodes;                   ///< p = -nodes..nodes
};

/// Empty where more than 10^5 nodes would be needed. `half_height` is omega t1, `ratio` is t1/t0.
std::optional<InversionHyperbola> inversion_hyperbola(double half_height, double ratio, const InversionAccuracy&);

/// One rule for all singularities: each half-line has its own hyperbola where these stay apart, others share one.
/// Throws Error where too many nodes are needed.
InversionRule inversion_rule(const std::vector<Complex>& singularities, bool real, double t0, double t1,
                             const InversionAccuracy&);

/// Weideman's modified Talbot contour for one t, s = c + N/t (-0.6122 + 0.5017 v cot(0.6407 v) + 0.2645 iv), N points
/// of v in (-pi, pi): errors of 10^{-0.6 N} (SIAM J. Numer. Anal. 44, 2006; Trefethen, Weideman, Schmelzer, BIT 46,
/// 2006).
InversionRule talbot_rule(Complex centre, bool real, double t, Index N);

/// e^{s_p t} weight_p for all t of a window, t x p, and the sizes of their errors: rounding of s, of s t and of F, and
/// at the ends of a hyperbola what comes behind.
struct InversionWeights {
  ComplexMatrix value;
  Matrix error;
};
InversionWeights inversion_weights(const InversionRule&, const Vector& t, double accuracy);

/// All t of one window, with a second rule of other parameters. Rows of the weights: `rows` of t, then t0, then t1, at
/// which neighbours must agree.
struct InversionWindow {
  std::vector<Index> rows;
  InversionRule rule, second;
  InversionWeights weights, second_weights;
};

/// Windows of ratio sqrt(10) from the largest t down to 1/1000 of the smallest one. Throws Error as invert_laplace
/// does.
std::vector<InversionWindow> inversion_windows(const Vector& t, const InversionOptions&);

/// For InversionContour::talbot: a rule for each t.
std::vector<InversionRule> talbot_rules(const Vector& t, const InversionOptions&);

}  // namespace bromwich
