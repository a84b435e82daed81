// Shifted solves at the nodes of a contour, all nodes at once.

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/kernel/kernel.hpp"
#include "cpu/failure.hpp"
#include "cpu/parts.hpp"

#include <Eigen/LU>

namespace bromwich::cpu {

namespace {

// Every sine mode mu_l of the constrained side sees one grid line at the shift z - mu_l: a closed form.
ComplexMatrix of(const KroneckerDynamics& dynamics, const ComplexVector& nodes, int threads) {
  const Vector mu = dynamics.along.eigenvalues();
  const Index n = mu.size();
  const LineTransfer transfer(dynamics.across, dynamics.n, dynamics.b);
  ComplexMatrix R(nodes.size(), n);
#pragma omp parallel for num_threads(threads) schedule(static) if (nodes.size() * n > 1 << 9)
  for (Index l = 0; l < n; ++l)
    for (Index p = 0; p < nodes.size(); ++p) R(p, l) = transfer(nodes[p] - mu[l]);
  return R;
}

ComplexMatrix of(const DenseDynamics& dynamics, const ComplexVector& nodes, int threads) {
  const Index n = dynamics.N.rows(), k = dynamics.B.cols(), m = dynamics.A.rows();
  ComplexMatrix R(nodes.size(), n * k);
  Failure failure;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1) if (m > 16)
  for (Index p = 0; p < nodes.size(); ++p) try {
      const ComplexMatrix shifted = nodes[p] * ComplexMatrix::Identity(m, m) - dynamics.A.cast<Complex>();
      const ComplexMatrix block = dynamics.N.cast<Complex>() * shifted.partialPivLu().solve(dynamics.B.cast<Complex>());
      for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < k; ++j) R(p, i * k + j) = block(i, j);
    } catch (...) {
      failure.keep();
    }
  failure.rethrow();
  return R;
}

ComplexMatrix of(const SparseDynamics& dynamics, const ComplexVector& nodes, int threads) {
  return sparse_resolvent(dynamics, nodes, threads);
}

ComplexMatrix of(const SuppliedDynamics& dynamics, const ComplexVector& nodes, int threads) {
  const Index n = dynamics.N.rows(), k = dynamics.B.cols(), m = dynamics.states;
  const ComplexMatrix B = Matrix(dynamics.B).cast<Complex>();
  const Eigen::SparseMatrix<Complex> N = dynamics.N.cast<Complex>();
  ComplexMatrix R(nodes.size(), n * k);
  const auto solve = [&](Index p) {
    const ComplexMatrix X = dynamics.shifted(nodes[p])(B);
    if (X.rows() != m || X.cols() != k)
      throw Error("shifted", text("returned %td x %td", X.rows(), X.cols()), text("return %td x %td, as R has", m, k));
    const ComplexMatrix block = N * X;
    for (Index i = 0; i < n; ++i)
      for (Index j = 0; j < k; ++j) R(p, i * k + j) = block(i, j);
  };
  if (!dynamics.thread_safe) {
    for (Index p = 0; p < nodes.size(); ++p) solve(p);
    return R;
  }
  Failure failure;
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
  for (Index p = 0; p < nodes.size(); ++p) try {
      solve(p);
    } catch (...) {
      failure.keep();
    }
  failure.rethrow();
  return R;
}

}  // namespace

ComplexMatrix resolvent(const Dynamics& dynamics, const ComplexVector& nodes, int threads) {
  ComplexMatrix R = std::visit([&](const auto& d) { return of(d, nodes, threads); }, dynamics);
  for (Index p = 0; p < nodes.size(); ++p)
    if (!R.row(p).allFinite()) throw eigenvalue_at(nodes[p]);
  return R;
}

}  // namespace bromwich::cpu
