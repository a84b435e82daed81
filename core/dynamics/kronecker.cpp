// Kronecker sums: diagonal in the sine modes of both sides.

#include "core/dynamics/kronecker.hpp"

#include "core/base/require.hpp"
#include "core/dynamics/dense.hpp"
#include "core/dynamics/line_transfer.hpp"
#include "core/dynamics/sparse.hpp"
#include "core/dynamics/spectrum.hpp"

#include <algorithm>
#include <vector>

namespace bromwich {

namespace {

Matrix dense_matrix(const SecondDifference& d) {
  const double scale = d.diffusivity / (d.spacing * d.spacing);
  Matrix D = Matrix::Zero(d.points, d.points);
  D.diagonal().setConstant(-2 * scale);
  D.diagonal(1).setConstant(scale);
  D.diagonal(-1).setConstant(scale);
  return D;
}

void validate_difference(const std::string& member, const SecondDifference& d) {
  require_some(member + ".points", d.points, "points");
  require_positive(member + ".spacing", d.spacing);
  require_positive(member + ".diffusivity", d.diffusivity);
}

class KroneckerSystem final : public SystemOf<KroneckerDynamics> {
 public:
  using SystemOf::SystemOf;

  Index states() const override { return d.along.points * d.across.points; }
  Index constraints() const override { return d.along.points; }
  void validate(bool) const override {
    validate_difference("along", d.along);
    validate_difference("across", d.across);
    require_length("b", d.b, d.across.points, "one per point of a line (across.points)");
    require_length("n", d.n, d.across.points, "one per point of a line (across.points)");
    require_finite("b", d.b);
    require_finite("n", d.n);
  }

  SparseMatrix inputs() const override { return to_sparse(d).B; }
  SparseMatrix outputs() const override { return to_sparse(d).N; }
  std::shared_ptr<LinearSystem> with_inputs_and_outputs(const SparseMatrix&, const SparseMatrix&) const override {
    throw Error("dynamics", "are a Kronecker sum", "write them out to give other B and N");
  }
  Vector observe(const Vector& x) const override {
    // It may see the first points of a line alone.
    Index seen = d.n.size();
    while (seen > 1 && d.n[seen - 1] == 0) --seen;
    return lines(x).leftCols(seen) * d.n.head(seen);
  }
  Vector observed_terms(const Vector& x) const override { return lines(x).cwiseAbs() * d.n.cwiseAbs(); }

  Spectrum spectrum() const override {
    const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues();
    Spectrum s;
    s.abscissa = mu.maxCoeff() + nu.maxCoeff();
    s.radius = -(mu.minCoeff() + nu.minCoeff());
    s.slowest = -s.abscissa;
    return s;
  }

  // Steps of the state take its sparse form.
  std::unique_ptr<ShiftedSystem<Complex>> at_shift(Complex z) const override {
    return linear_system(to_sparse(d))->at_shift(z);
  }
  std::unique_ptr<ShiftedSystem<double>> at_shift(double z) const override {
    return linear_system(to_sparse(d))->at_shift(z);
  }

  const KroneckerDynamics* modes() const override { return &d; }

  std::shared_ptr<const DenseDynamics> dense_form() const override {
    const Index count = d.along.points, length = d.across.points, m = states();
    require_dense_size(m);
    const Matrix along = dense_matrix(d.along), across = dense_matrix(d.across);
    DenseDynamics dense{Matrix::Zero(m, m), Matrix::Zero(m, count), Matrix::Zero(count, m)};
    for (Index l = 0; l < count; ++l) {
      for (Index k = 0; k < count; ++k)
        dense.A.block(l * length, k * length, length, length).diagonal().setConstant(along(l, k));
      dense.A.block(l * length, l * length, length, length) += across;
      dense.B.block(l * length, l, length, 1) = d.b;
      dense.N.block(l, l * length, 1, length) = d.n.transpose();
    }
    return std::make_shared<DenseDynamics>(std::move(dense));
  }

 private:
  Eigen::Map<const RowMatrix> lines(const Vector& x) const { return {x.data(), d.along.points, d.across.points}; }

  // Closed form: sine mode mu_l of the constrained side is a single grid line with the shift z - mu_l.
  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads& threads) const override {
    const Vector mu = d.along.eigenvalues();
    const Index n = mu.size();
    const LineTransfer transfer(d.across, d.n, d.b);
    ComplexMatrix R(nodes.size(), n);
    const Index fewest = (Index(1) << 9) / std::max<Index>(nodes.size(), 1) + 1;  // lines: as long as waking a thread
    share(threads, n, std::max(fewest, n / (4 * threads.threads())), [&](Index first, Index last) {
      for (Index l = first; l < last; ++l)
        for (Index p = 0; p < nodes.size(); ++p) R(p, l) = transfer(nodes[p] - mu[l]);
    });
    return R;
  }
};

}  // namespace

std::shared_ptr<LinearSystem> linear_system(KroneckerDynamics d) {
  return std::make_shared<KroneckerSystem>(std::move(d));
}

SparseDynamics to_sparse(const KroneckerDynamics& d) {
  const Index lines = d.along.points, length = d.across.points, m = lines * length;
  const double along = d.along.diffusivity / (d.along.spacing * d.along.spacing);
  const double across = d.across.diffusivity / (d.across.spacing * d.across.spacing);
  std::vector<Eigen::Triplet<double>> A, B, N;
  for (Index l = 0; l < lines; ++l)
    for (Index k = 0; k < length; ++k) {
      const Index i = l * length + k;
      A.emplace_back(i, i, -2 * (along + across));
      if (k > 0) A.emplace_back(i, i - 1, across);
      if (k + 1 < length) A.emplace_back(i, i + 1, across);
      if (l > 0) A.emplace_back(i, i - length, along);
      if (l + 1 < lines) A.emplace_back(i, i + length, along);
      if (d.b[k] != 0) B.emplace_back(i, l, d.b[k]);
      if (d.n[k] != 0) N.emplace_back(l, i, d.n[k]);
    }
  SparseDynamics sparse{SparseMatrix(m, m), SparseMatrix(m, lines), SparseMatrix(lines, m)};
  sparse.A.setFromTriplets(A.begin(), A.end());
  sparse.B.setFromTriplets(B.begin(), B.end());
  sparse.N.setFromTriplets(N.begin(), N.end());
  return sparse;
}

}  // namespace bromwich
