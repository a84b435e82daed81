// Shifted solves at the nodes of a contour, all nodes at once.

#include "core/error.hpp"
#include "core/kernel.hpp"
#include "cpu/parts.hpp"

#include <Eigen/LU>

#include <cstdio>

namespace bromwich::cpu {

Error eigenvalue_at(Complex z) {
  char text[96];
  std::snprintf(text, sizeof text, "found an eigenvalue of A at or next to the node %.6g%+.6gi", z.real(), z.imag());
  return Error("resolvent", text, "choose nodes away from the spectrum");
}

namespace {

// Every sine mode mu_l of the constrained side sees one grid line at the shift z - mu_l: a closed form.
ComplexMatrix of(const KroneckerDynamics& dynamics, const ComplexVector& nodes, int threads) {
  const Vector mu = dynamics.along.eigenvalues();
  const Index n = mu.size();
  ComplexMatrix R(nodes.size(), n);
#pragma omp parallel for num_threads(threads) schedule(static) if (nodes.size() * n > 256)
  for (Index l = 0; l < n; ++l)
    for (Index p = 0; p < nodes.size(); ++p)
      R(p, l) = line_transfer(dynamics.across, dynamics.n, dynamics.b, nodes[p] - mu[l]);
  return R;
}

ComplexMatrix of(const DenseDynamics& dynamics, const ComplexVector& nodes, int threads) {
  const Index n = dynamics.N.rows(), k = dynamics.B.cols(), m = dynamics.A.rows();
  ComplexMatrix R(nodes.size(), n * k);
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1) if (m > 16)
  for (Index p = 0; p < nodes.size(); ++p) {
    const ComplexMatrix shifted = nodes[p] * ComplexMatrix::Identity(m, m) - dynamics.A.cast<Complex>();
    const ComplexMatrix block = dynamics.N.cast<Complex>() * shifted.partialPivLu().solve(dynamics.B.cast<Complex>());
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < k; ++j) R(p, i * k + j) = block(i, j);
  }
  for (Index p = 0; p < nodes.size(); ++p)
    if (!R.row(p).allFinite()) throw eigenvalue_at(nodes[p]);
  return R;
}

ComplexMatrix of(const SparseDynamics& dynamics, const ComplexVector& nodes, int threads) {
  return sparse_resolvent(dynamics, nodes, threads);
}

}  // namespace

ComplexMatrix resolvent(const Dynamics& dynamics, const ComplexVector& nodes, int threads) {
  return std::visit([&](const auto& d) { return of(d, nodes, threads); }, dynamics);
}

}  // namespace bromwich::cpu
