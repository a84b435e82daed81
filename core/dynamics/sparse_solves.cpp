// N (z_p E - A)^{-1} B for sparse A and E by multifrontal elimination (core/dynamics/fronts.hpp).
//
// No pivoting: for z outside the numerical range of A, a rotation of zE - A has a positive definite Hermitian part, and
// every elimination order is stable. This is verified: a test column (zE - A) u, u = ±1, with the known answer N u is
// solved along with B. A node that misses it is solved again by LU factorization with partial pivoting.

#include "core/dynamics/sparse_solves.hpp"

#include "core/base/interruption.hpp"
#include "core/dynamics/fronts.hpp"
#include "core/dynamics/linear_system.hpp"

#include <Eigen/SparseLU>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace bromwich::multifrontal {

namespace {

// A node whose test column misses N u by more is solved again. Rounding grows with the condition number of zE - A,
// about ||A|| over the distance of z from the spectrum: 1e6 for a fine grid.
constexpr double accepted_miss = 1e-8;
// Bound for the LU factorization: with fewer than four correct digits the matrix counts as singular.
constexpr double accepted_pivoted_miss = 1e-4;

// Largest relative deviation of an answer from N u.
template <class Answer>
double miss(const Vector& Nu, const Vector& scale, const Answer& answer) {
  double worst = 0;
  for (Index i = 0; i < Nu.size(); ++i) {
    const double deviation = std::abs(answer(i) - Nu[i]);
    if (!std::isfinite(deviation)) return INFINITY;
    if (scale[i] > 0) worst = std::max(worst, deviation / scale[i]);
  }
  return worst;
}

// LU factorization with partial pivoting for one node.
bool solve_pivoted(const System& s, Complex z, Eigen::Ref<Eigen::RowVectorXcd> out) {
  Eigen::SparseMatrix<Complex> shifted(s.A.rows(), s.A.cols());
  if (s.mass())
    shifted = s.E.cast<Complex>();
  else
    shifted.setIdentity();
  shifted = z * shifted - s.A.cast<Complex>();
  shifted.makeCompressed();
  Eigen::SparseLU<Eigen::SparseMatrix<Complex>> lu;
  lu.compute(shifted);
  if (lu.info() != Eigen::Success) return false;
  const Eigen::SparseMatrix<Complex> N = s.N.cast<Complex>();
  const ComplexVector test = lu.solve(ComplexVector(z * s.Eu.cast<Complex>() - s.Au.cast<Complex>()));
  if (!((test - s.u).cwiseAbs().maxCoeff() < accepted_pivoted_miss)) return false;
  for (Index c = 0; c < s.B.cols(); ++c) {
    const ComplexVector column = N * ComplexVector(lu.solve(ComplexVector(s.B.col(c).cast<Complex>())));
    for (Index i = 0; i < column.size(); ++i) out[i * s.B.cols() + c] = column[i];
  }
  return out.allFinite();
}

}  // namespace

ComplexMatrix sparse_shifted_solves(const SparseMatrix& A, const SparseMatrix& E, const SparseMatrix& B,
                                    const SparseMatrix& N, const ComplexVector& nodes, const HostThreads& threads) {
  const System system(A, E, B, N);
  const Index n = N.rows(), k = B.cols(), groups = blocks(nodes.size());
  const Vector Nu = N * system.u, scale = N.cwiseAbs() * Vector::Ones(N.cols());
  ComplexMatrix R(nodes.size(), n * k);
  std::vector<char> again(std::size_t(nodes.size()), 0);
  const Index together = (groups + threads.threads() - 1) / threads.threads();
  std::atomic<bool> stopped = false;  // the user is asked by the calling thread alone
  share(threads, groups, std::max<Index>(together, 1), [&](Index first, Index last) {
    Fronts fronts(system);
    for (Index g = first; g < last && !stopped; ++g) {
      try {
        check_interruption();
      } catch (...) {
        stopped = true;
        throw;
      }
      Entry z;
      for (Index lane = 0; lane < lanes; ++lane) {
        const Complex node = nodes[std::min(g * lanes + lane, nodes.size() - 1)];
        z.re[lane] = node.real();
        z.im[lane] = node.imag();
      }
      fronts.run(z);
      for (Index lane = 0; lane < lanes && g * lanes + lane < nodes.size(); ++lane) {
        const Index p = g * lanes + lane;
        for (Index i = 0; i < n; ++i)
          for (Index c = 0; c < k; ++c) R(p, i * k + c) = fronts.result(i, c, lane);
        const double missed = miss(Nu, scale, [&](Index i) { return fronts.result(i, k, lane); });
        again[std::size_t(p)] = !(missed <= accepted_miss) || !R.row(p).allFinite();
      }
    }
  });
  for (Index p = 0; p < nodes.size(); ++p) {
    if (!again[std::size_t(p)]) continue;
    Eigen::RowVectorXcd row(n * k);
    if (!solve_pivoted(system, nodes[p], row)) throw eigenvalue_at(nodes[p]);
    R.row(p) = row;
  }
  return R;
}

}  // namespace bromwich::multifrontal
