#pragma once
// Radau IIA with many stages as a collocation method (Hairer, Wanner, Solving Ordinary Differential Equations II,
// IV.5). It is L-stable and of order 2 s - 1 at the ends of steps, and it gives a polynomial of degree s on the whole
// step.
//
// symbol  variable     shape           meaning
// s       degree       1               stages, and the degree of all polynomials
// c       nodes        s               Radau points in (0, 1], the last is 1
// A       -            s x s           integrals of the Lagrange polynomials of c, A = W diag(lambda) W^{-1}
// P_k     legendre     s+1             Legendre polynomials shifted to [0, 1]
//
// A polynomial with several components is an (s+1) x components matrix of Legendre coefficients.

#include "../base/types.hpp"
#include "../numerics/legendre.hpp"

#include <vector>

namespace bromwich {

struct Collocation {
  static constexpr Index degree = legendre_degree;
  using Square = Eigen::Matrix<double, degree + 1, degree + 1>;
  using Stages = Eigen::Matrix<double, degree, degree + 1>;

  Vector nodes;
  Stages stages;           ///< s x (s+1): from coefficients to values at c
  Stages integrals;        ///< s x (s+1): from coefficients to integrals over [0, c_i]
  Square coefficients;     ///< (s+1) x (s+1): from values at 0 and at c to coefficients
  Square derivative;       ///< (s+1) x (s+1): from coefficients to those of the derivative
  Square bernstein;        ///< (s+1) x (s+1): from coefficients to those in the Bernstein basis
  LegendreValues samples;  ///< s+1 points inside (0, 1) at which sources are sampled
  Square from_samples;     ///< (s+1) x (s+1): from values there to coefficients
  Eigen::Vector3d checks;  ///< further points, where the polynomial of a source is compared with the source
  Eigen::Matrix<double, 3, degree + 1> at_checks;  ///< from coefficients to values there

  /// An eigenvalue of A with nonnegative imaginary part. X = sum over these of Re(weight * right * (left X)), with
  /// weight 1 for a real one and 2 for one of a pair.
  struct Eigenvalue {
    Complex value;
    ComplexVector right, left;  ///< a column of W, a row of W^{-1}
    double weight;
  };
  std::vector<Eigenvalue> eigenvalues;

  static const Collocation& get();
};

/// by * c, column by column.
inline void transform(const Collocation::Square& by, LegendreCoefficients& c) {
  for (Index i = 0; i < c.cols(); ++i) c.col(i) = LegendreValues(by * c.col(i));
}

/// The first point of [0, 1] at which a polynomial, given by its Bernstein coefficients, is below -noise; 1 if it is
/// nowhere. Exact to 2^-50: the polynomial lies in the convex hull of its coefficients, and intervals are halved until
/// that decides.
double first_below(const LegendreValues& bernstein, double noise);

/// The last zero of a polynomial (Legendre coefficients) before `at`, where it is negative; 0 if there is none.
double zero_before(const LegendreValues& coefficients, double at);

}  // namespace bromwich
