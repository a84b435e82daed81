#include "core/numerics/sectorial.hpp"

#include "core/numerics/contour.hpp"
#include "core/numerics/contour_phi.hpp"
#include "core/numerics/phi.hpp"

#include <Eigen/Cholesky>

#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

// The hyperbolas for double poles at 0 contain these sectors up to a shift of 1/4: phi_k(z), k <= 5, has an error of
// 6e-15/k! for every z in them. Those for narrower sectors pass closer to the pole; phi_4 and phi_5 are less accurate.
constexpr double sector_shift = 0.25;
constexpr double radians_per_degree = std::numbers::pi / 180;

}  // namespace

Balanced balanced(const Matrix& A) {
  constexpr int most_sweeps = 20;
  const Index m = A.rows();
  Balanced b{A, Vector::Ones(m)};
  bool changed = true;
  for (int sweep = 0; changed && sweep < most_sweeps; ++sweep) {
    changed = false;
    for (Index i = 0; i < m; ++i) {
      const double own = std::abs(b.A(i, i));
      const double column = b.A.col(i).cwiseAbs().sum() - own, row = b.A.row(i).cwiseAbs().sum() - own;
      if (!(column > 0) || !(row > 0)) continue;
      const double factor = std::exp2(std::round(std::log2(row / column) / 2));
      if (!(column * factor + row / factor < 0.95 * (column + row))) continue;
      b.A.col(i) *= factor;
      b.A.row(i) /= factor;
      b.D[i] *= factor;
      changed = true;
    }
  }
  return b;
}

// Re(e^{±i(pi/2 - half_angle)} z) <= 0 for all z - shift of the numerical range; A is real, and one sign implies the
// other.
bool in_sector(const Matrix& A, double half_angle, double shift) {
  ComplexMatrix turned = -A.cast<Complex>();
  turned.diagonal().array() += shift;
  turned *= std::polar(1.0, std::numbers::pi / 2 - half_angle);
  const ComplexMatrix hermitian = (turned + turned.adjoint()) / 2;
  return hermitian.allFinite() && Eigen::LLT<ComplexMatrix>(hermitian).info() == Eigen::Success;
}

// Balancing may amplify a coupling of fast to slow modes. So the matrix as given is tried second.
std::optional<std::vector<Matrix>> sectorial_phis(const Matrix& A, int last) {
  for (const Balanced& b : {balanced(A), Balanced{A, Vector::Ones(A.rows())}})
    for (const double half_angle : {45 * radians_per_degree, 60 * radians_per_degree}) {
      if (!in_sector(b.A, half_angle, sector_shift)) continue;
      std::vector<Matrix> phis = contour_phis(b.A, near_contour(*contour_parameters(half_angle), 1), last);
      for (Matrix& phi : phis) phi = (b.D.asDiagonal() * phi * b.D.cwiseInverse().asDiagonal()).eval();
      return phis;
    }
  return std::nullopt;
}

}  // namespace bromwich
