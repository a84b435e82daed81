#include "core/numerics/contour_phi.hpp"

#include <Eigen/LU>

#include <cmath>

namespace bromwich {

std::vector<Matrix> contour_phis(const Matrix& A, const Contour& contour, int last) {
  const Index m = A.rows();
  std::vector<Matrix> p(std::size_t(last) + 1, Matrix::Zero(m, m));
  for (Index i = 0; i < contour.nodes.size(); ++i) {
    const Complex z = contour.nodes[i];
    ComplexMatrix shifted = -A.cast<Complex>();
    shifted.diagonal().array() += z;
    const ComplexMatrix inverse = shifted.partialPivLu().inverse();
    Complex factor = contour.weights[i] * std::exp(z);
    for (Matrix& value : p) {
      value += (factor * inverse).real();
      factor /= z;
    }
  }
  return p;
}

}  // namespace bromwich
