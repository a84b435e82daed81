#include "derivatives/part_maps.hpp"

#include "core/base/error.hpp"
#include "core/events/collocation.hpp"

#include <array>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr int series = 16;  ///< terms at |z| <= 1/2: the rest is below 2^-60

// phi_0, ..., phi_{degree+1} of Z.
std::vector<Matrix> phi_functions(const Matrix& Z) {
  const Index m = Z.rows();
  constexpr int most = int(degree) + 1;
  const double size = m > 0 ? Z.cwiseAbs().rowwise().sum().maxCoeff() : 0;
  if (!std::isfinite(size)) throw Error("derivative", "the dynamics of an active set are not finite", "scale the data");
  int doublings = 0;
  while (std::ldexp(size, -doublings) > 0.5) ++doublings;
  const Matrix W = std::ldexp(1.0, -doublings) * Z, I = Matrix::Identity(m, m);
  std::array<double, most + series + 2> factorial{1};
  for (std::size_t k = 1; k < factorial.size(); ++k) factorial[k] = double(k) * factorial[k - 1];
  std::vector<Matrix> phi(std::size_t(most) + 1, I);
  Matrix last = I / factorial[std::size_t(most + series)];
  for (int j = series - 1; j >= 0; --j) last = (I / factorial[std::size_t(most + j)] + W * last).eval();
  phi.back() = last;
  for (int k = most - 1; k >= 0; --k) phi[std::size_t(k)] = I / factorial[std::size_t(k)] + W * phi[std::size_t(k) + 1];
  for (int d = 0; d < doublings; ++d) {
    const std::vector<Matrix> half = phi;
    for (int k = 0; k <= most; ++k) {
      Matrix sum = half[0] * half[std::size_t(k)];
      for (int j = 1; j <= k; ++j) sum += half[std::size_t(j)] / factorial[std::size_t(k - j)];
      phi[std::size_t(k)] = std::ldexp(1.0, -k) * sum;
    }
  }
  return phi;
}

// c_kj j!: P_k(s) = Σ_j (-1)^{k+j} (k+j)! / ((j!)^2 (k-j)!) s^j.
double coefficient(Index k, Index j) {
  double c = (k + j) % 2 == 0 ? 1 : -1;
  for (Index i = k - j + 1; i <= k + j; ++i) c *= double(i);
  for (Index i = 2; i <= j; ++i) c /= double(i);
  return c;
}

}  // namespace

PartMaps part_maps(const Matrix& A, double length) {
  const std::vector<Matrix> phi = phi_functions(length * A);
  PartMaps maps{phi[0], {}};
  for (Index k = 0; k <= degree; ++k) {
    Matrix sum = Matrix::Zero(A.rows(), A.rows());
    for (Index j = 0; j <= k; ++j) sum += (length * coefficient(k, j)) * phi[std::size_t(j) + 1];
    maps.inputs.push_back(std::move(sum));
  }
  return maps;
}

Matrix restricted(double from, double width) {
  const Collocation& c = Collocation::get();
  Matrix values(degree + 1, degree + 1);
  for (Index k = 0; k <= degree; ++k) values.row(k) = legendre(from + width * c.samples[k]).transpose();
  return c.from_samples * values;
}

}  // namespace bromwich
