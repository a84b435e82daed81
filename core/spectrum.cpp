#include "core/spectrum.hpp"

#include <Eigen/Eigenvalues>

#include <cmath>
#include <cstdio>

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
  if (d.A.rows() == 0) return s;
  const ComplexVector eigenvalues = Eigen::EigenSolver<Matrix>(d.A, false).eigenvalues();
  s.radius = eigenvalues.cwiseAbs().maxCoeff();
  s.abscissa = eigenvalues.real().maxCoeff();
  // The QR algorithm returns eigenvalues to about eps ||A||: smaller ones are zero, and so are smaller imaginary parts.
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
  return d.A.rows() <= exact_size ? of(DenseDynamics{Matrix(d.A), {}, {}}) : sparse_spectrum(d.A);
}

}  // namespace

std::string Spectrum::describe() const {
  char text[128];
  if (real_negative() && slowest == 0)
    std::snprintf(text, sizeof text, "real, moduli up to %.3g", radius);
  else if (real_negative())
    std::snprintf(text, sizeof text, "real, moduli %.3g to %.3g", slowest, radius);
  else if (abscissa > 16 * epsilon * radius)
    std::snprintf(text, sizeof text, "unstable, abscissa %.3g", abscissa);
  else
    std::snprintf(text, sizeof text, "sector of half-angle %.1f degrees, moduli %.3g to %.3g",
                  half_angle * 57.29577951308232, slowest, radius);
  return text;
}

Spectrum spectrum(const Dynamics& dynamics) {
  return std::visit([](const auto& d) { return of(d); }, dynamics);
}

}  // namespace bromwich
