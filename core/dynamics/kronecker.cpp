// Kronecker sums: diagonal in the modes of the face and the modes of a line across it.

#include "core/dynamics/kronecker.hpp"

#include "core/base/require.hpp"
#include "core/base/text.hpp"
#include "core/dynamics/dense.hpp"
#include "core/dynamics/line_transfer.hpp"
#include "core/dynamics/sparse.hpp"
#include "core/dynamics/spectrum.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

void validate_difference(const std::string& member, const SecondDifference& d) {
  require_some(member + ".points", d.points, "points");
  require_positive(member + ".spacing", d.spacing);
  require_positive(member + ".diffusivity", d.diffusivity);
  for (const auto& [name, q] : {std::pair(".first", d.first), {".last", d.last}})
    if (!(q > -1 && q <= 1))
      throw Error(member + name, "is " + text("%g", q), "give a reflection above -1 and up to 1 (0: Dirichlet)");
  if (!std::isfinite(d.decay)) throw Error(member + ".decay", "is " + text("%g", d.decay), "give a finite number");
}

class KroneckerSystem final : public SystemOf<KroneckerDynamics> {
 public:
  using SystemOf::SystemOf;

  Index states() const override { return d.lines() * d.across.points; }
  Index constraints() const override { return d.face_points(); }
  void validate(bool) const override {
    validate_difference("along", d.along);
    validate_difference("across", d.across);
    for (std::size_t i = 0; i < d.beside.size(); ++i)
      validate_difference("beside[" + std::to_string(i) + "]", d.beside[i]);
    require_length("b", d.b, d.across.points, "one per point of a line (across.points)");
    require_length("n", d.n, d.across.points, "one per point of a line (across.points)");
    require_finite("b", d.b);
    require_finite("n", d.n);
    if (d.both_faces && d.across.first != d.across.last)
      throw Error("across", "has two ends that differ", "give constraints on both faces as a Rectangle");
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
    if (!d.both_faces) return lines(x).leftCols(seen) * d.n.head(seen);
    return lines(d.views(x)).leftCols(seen) * d.n.head(seen);
  }
  Vector observed_terms(const Vector& x) const override { return lines(d.views(x)).cwiseAbs() * d.n.cwiseAbs(); }

  Spectrum spectrum() const override {
    const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
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
    require_dense_size(states());
    const SparseDynamics sparse = to_sparse(d);
    DenseDynamics dense{Matrix(sparse.A), Matrix(sparse.B), Matrix(sparse.N)};
    return std::make_shared<DenseDynamics>(std::move(dense));
  }

 private:
  Eigen::Map<const RowMatrix> lines(const Vector& x) const { return {x.data(), d.face_points(), d.across.points}; }

  // Closed form: mode mu_l of the constrained side is a single grid line with the shift z - mu_l.
  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads& threads) const override {
    const Vector mu = d.face_eigenvalues();
    const Index n = mu.size();
    std::vector<LineTransfer> transfer;
    for (Index f = 0; f < d.families(); ++f) transfer.emplace_back(d.across, d.n, d.input(f));
    ComplexMatrix R(nodes.size(), n);
    const Index fewest = (Index(1) << 9) / std::max<Index>(nodes.size(), 1) + 1;  // lines: as long as waking a thread
    share(threads, n, std::max(fewest, n / (4 * threads.threads())), [&](Index first, Index last) {
      for (Index l = first; l < last; ++l)
        for (Index p = 0; p < nodes.size(); ++p) R(p, l) = transfer[std::size_t(d.family(l))](nodes[p] - mu[l]);
    });
    return R;
  }
};

}  // namespace

std::shared_ptr<LinearSystem> linear_system(KroneckerDynamics d) {
  return std::make_shared<KroneckerSystem>(std::move(d));
}

std::vector<SecondDifference> KroneckerDynamics::face() const {
  std::vector<SecondDifference> directions{along};
  directions.insert(directions.end(), beside.begin(), beside.end());
  return directions;
}

FaceBasis KroneckerDynamics::face_basis() const {
  std::vector<LineBasis> directions;
  if (both_faces) {
    const double part = std::sqrt(0.5);
    directions.push_back({2, std::make_shared<const Matrix>(Matrix{{part, part}, {part, -part}})});
  }
  for (const SecondDifference& direction : face()) directions.push_back(direction.basis().directions().front());
  return FaceBasis(std::move(directions));
}

Index KroneckerDynamics::face_points() const { return families() * lines(); }

Index KroneckerDynamics::lines() const {
  Index points = along.points;
  for (const SecondDifference& direction : beside) points *= direction.points;
  return points;
}

Vector KroneckerDynamics::face_eigenvalues() const {
  Vector sums = along.eigenvalues();
  for (const SecondDifference& direction : beside) {
    const Vector next = direction.eigenvalues(), before = sums;
    sums.resize(before.size() * next.size());
    for (Index i = 0; i < before.size(); ++i) sums.segment(i * next.size(), next.size()) = next.array() + before[i];
  }
  return sums.replicate(families(), 1);
}

Vector KroneckerDynamics::input(Index family) const {
  if (!both_faces) return b;
  return family == 0 ? Vector(b + b.reverse()) : Vector(b - b.reverse());
}

Matrix KroneckerDynamics::inputs_in_modes() const {
  Matrix inputs(across.points, families());
  for (Index f = 0; f < families(); ++f) inputs.col(f) = across.in_modes(input(f));
  return inputs;
}

RowMatrix KroneckerDynamics::of_modes(const Matrix& of_families) const {
  RowMatrix values(of_families.rows(), face_points());
  for (Index l = 0; l < values.cols(); ++l) values.col(l) = of_families.col(of_families.cols() > 1 ? family(l) : 0);
  return values;
}

Vector KroneckerDynamics::views(const Vector& x) const {
  if (!both_faces) return x;
  Vector both(2 * x.size());
  both.head(x.size()) = x;
  const Eigen::Map<const RowMatrix> near(x.data(), lines(), across.points);
  Eigen::Map<RowMatrix>(both.data() + x.size(), lines(), across.points) = near.rowwise().reverse();
  return both;
}

SparseDynamics to_sparse(const KroneckerDynamics& d) {
  const Index lines = d.lines(), n = d.face_points(), length = d.across.points, m = lines * length;
  std::vector<SecondDifference> directions = d.face();
  directions.push_back(d.across);
  std::vector<Eigen::Triplet<double>> A, B, N;
  Index stride = m;
  for (const SecondDifference& direction : directions) {
    const double scale = direction.diffusivity / (direction.spacing * direction.spacing);
    stride /= direction.points;
    for (Index i = 0; i < m; ++i) {
      const Index k = i / stride % direction.points;
      double diagonal = -2 * scale - direction.decay;
      if (k == 0) diagonal += scale * direction.first;
      if (k + 1 == direction.points) diagonal += scale * direction.last;
      A.emplace_back(i, i, diagonal);
      if (k > 0) A.emplace_back(i, i - stride, scale);
      if (k + 1 < direction.points) A.emplace_back(i, i + stride, scale);
    }
  }
  for (Index l = 0; l < lines; ++l)
    for (Index k = 0; k < length; ++k) {
      const Index i = l * length + k;
      for (Index c = l; c < n; c += lines) {
        const Index from_face = c < lines ? k : length - 1 - k;
        if (d.b[from_face] != 0) B.emplace_back(i, c, d.b[from_face]);
        if (d.n[from_face] != 0) N.emplace_back(c, i, d.n[from_face]);
      }
    }
  SparseDynamics sparse{SparseMatrix(m, m), SparseMatrix(m, n), SparseMatrix(n, m)};
  sparse.A.setFromTriplets(A.begin(), A.end());
  sparse.B.setFromTriplets(B.begin(), B.end());
  sparse.N.setFromTriplets(N.begin(), N.end());
  return sparse;
}

}  // namespace bromwich
