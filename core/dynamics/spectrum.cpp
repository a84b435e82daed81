#include "core/dynamics/spectrum.hpp"

#include "core/base/text.hpp"

#include <Eigen/Eigenvalues>

#include <cmath>

namespace bromwich {

namespace {

Spectrum of(const KroneckerDynamics& d) {
  const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues();
  Spectrum s;
  s.abscissa = mu.maxCoeff() + nu.maxCoeff();
  s.radius = -(mu.minCoeff() + nu.minCoeff());
  s.slowest = -s.abscissa;
  return s;
}

Spectrum of(const DenseDynamics& d) {
  Spectrum s;
  if (d.E.rows() > 0) {
    const Matrix A = d.E.partialPivLu().solve(d.A);
    return A.allFinite() ? of(DenseDynamics{A, {}, {}}) : s;
  }
  if (d.A.rows() == 0) return s;
  const ComplexVector eigenvalues = Eigen::EigenSolver<Matrix>(d.A, false).eigenvalues();
  s.non_normal = (d.A * d.A.transpose() - d.A.transpose() * d.A).norm() > 0.1 * d.A.squaredNorm();
  s.radius = eigenvalues.cwiseAbs().maxCoeff();
  s.abscissa = eigenvalues.real().maxCoeff();
  // The QR algorithm has an error of about eps ||A||: smaller eigenvalues and imaginary parts are set to zero.
  const double rounding = 16 * epsilon * d.A.norm();
  for (const Complex lambda : eigenvalues) {
    if (std::abs(lambda) <= rounding) continue;
    s.slowest = s.slowest == 0 ? std::abs(lambda) : std::min(s.slowest, std::abs(lambda));
    const double angle = std::abs(std::arg(-lambda));
    if (std::abs(lambda.imag()) > rounding || lambda.real() > 0) s.half_angle = std::max(s.half_angle, angle);
  }
  return s;
}

Spectrum of(const SparseDynamics& d) {
  constexpr Index exact_size = 256;  // 25 m^3 operations: below a second
  if (d.A.rows() > exact_size) return d.E.rows() > 0 ? sparse_spectrum(d.A, d.E) : sparse_spectrum(d.A);
  return of(DenseDynamics{Matrix(d.A), {}, {}, Matrix(d.E)});
}

Spectrum of(const SuppliedDynamics& d) {
  if (!d.bound) return supplied_spectrum(d);
  Spectrum s;
  s.half_angle = d.bound->half_angle;
  s.abscissa = d.bound->abscissa;
  s.bound = true;
  return s;
}

}  // namespace

std::string Spectrum::describe() const {
  constexpr double degree = 57.29577951308232;
  if (bound) return text("bound given: half-angle %.1f degrees, abscissa %.3g", half_angle * degree, abscissa);
  if (radius == 0) return "zero";
  const bool unstable = abscissa > 16 * epsilon * radius, imaginary = !unstable && half_angle * degree > 89.9999;
  const std::string kind = unstable          ? text("unstable, abscissa %.3g", abscissa)
                           : real_negative() ? "real"
                           : imaginary       ? "imaginary"
                                             : text("sector of half-angle %.1f degrees", half_angle * degree);
  const std::string moduli = slowest > 0 && slowest < radius ? text(", moduli %.3g to %.3g", slowest, radius)
                             : slowest > 0                   ? text(", modulus %.3g", radius)
                                                             : text(", moduli up to %.3g", radius);
  const bool stiff = slowest > 0 && radius > 1e6 * slowest;
  return kind + moduli + (stiff ? ", stiff" : "") + (non_normal ? ", non-normal" : "");
}

Spectrum spectrum(const Dynamics& dynamics) {
  return std::visit([](const auto& d) { return of(d); }, dynamics);
}

}  // namespace bromwich
