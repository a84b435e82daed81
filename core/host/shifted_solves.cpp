// Shifted solves at the nodes of a contour, all nodes at once.

#include "core/host/shifted_solves.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/dynamics/line_transfer.hpp"
#include "core/host/shifted_solves_sparse.hpp"

#include <Eigen/LU>

#include <algorithm>

namespace bromwich::host {

namespace {

// Closed form: sine mode mu_l of the constrained side is a single grid line with the shift z - mu_l.
ComplexMatrix of(const KroneckerDynamics& dynamics, const ComplexVector& nodes, const HostThreads& threads) {
  const Vector mu = dynamics.along.eigenvalues();
  const Index n = mu.size();
  const LineTransfer transfer(dynamics.across, dynamics.n, dynamics.b);
  ComplexMatrix R(nodes.size(), n);
  const Index fewest = (Index(1) << 9) / std::max<Index>(nodes.size(), 1) + 1;  // lines: as long as waking a thread
  share(threads, n, std::max(fewest, n / (4 * threads.threads())), [&](Index first, Index last) {
    for (Index l = first; l < last; ++l)
      for (Index p = 0; p < nodes.size(); ++p) R(p, l) = transfer(nodes[p] - mu[l]);
  });
  return R;
}

ComplexMatrix of(const DenseDynamics& dynamics, const ComplexVector& nodes, const HostThreads& threads) {
  const Index n = dynamics.N.rows(), k = dynamics.B.cols(), m = dynamics.A.rows();
  ComplexMatrix R(nodes.size(), n * k);
  const Index together = m > 16 ? 1 : nodes.size();
  share(threads, nodes.size(), std::max<Index>(together, 1), [&](Index first, Index last) {
    for (Index p = first; p < last; ++p) {
      const ComplexMatrix shifted = nodes[p] * ComplexMatrix::Identity(m, m) - dynamics.A.cast<Complex>();
      const ComplexMatrix block = dynamics.N.cast<Complex>() * shifted.partialPivLu().solve(dynamics.B.cast<Complex>());
      for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < k; ++j) R(p, i * k + j) = block(i, j);
    }
  });
  return R;
}

ComplexMatrix of(const SparseDynamics& dynamics, const ComplexVector& nodes, const HostThreads& threads) {
  return sparse_shifted_solves(dynamics, nodes, threads);
}

ComplexMatrix of(const SuppliedDynamics& dynamics, const ComplexVector& nodes, const HostThreads& threads) {
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
  share_each(dynamics.thread_safe ? threads : HostThreads(), nodes.size(), solve);
  return R;
}

}  // namespace

}  // namespace bromwich::host

namespace bromwich {

ComplexMatrix shifted_solves(const Dynamics& dynamics, const ComplexVector& nodes, const HostThreads& threads) {
  ComplexMatrix R = std::visit([&](const auto& d) { return host::of(d, nodes, threads); }, dynamics);
  for (Index p = 0; p < nodes.size(); ++p)
    if (!R.row(p).allFinite()) throw eigenvalue_at(nodes[p]);
  return R;
}

}  // namespace bromwich
