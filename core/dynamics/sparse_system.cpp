// Sparse dynamics: known by shifted solves, one elimination for all nodes of a contour (sparse_solves.hpp) or one
// factorization for all steps.

#include "core/dynamics/sparse_system.hpp"

#include "core/dynamics/dense.hpp"
#include "core/dynamics/sparse_solves.hpp"
#include "core/dynamics/spectrum.hpp"

#include <Eigen/SparseLU>

#include <cmath>

namespace bromwich {

namespace {

template <class Scalar>
class SparseShift final : public ShiftedSystem<Scalar> {
  using ScalarSparse = Eigen::SparseMatrix<Scalar>;

 public:
  using typename ShiftedSystem<Scalar>::Columns;
  using typename ShiftedSystem<Scalar>::Column;
  SparseShift(const SparseDynamics& d, Scalar z) {
    ScalarSparse shifted(d.A.rows(), d.A.cols());
    if (d.E.rows() > 0)
      shifted = d.E.cast<Scalar>();
    else
      shifted.setIdentity();
    shifted = (z * shifted - d.A.cast<Scalar>()).pruned(Scalar(0), 0);
    shifted.makeCompressed();
    lu_.compute(shifted);
    regular_ = lu_.info() == Eigen::Success && finds_known_solution(shifted);
  }
  bool regular() const { return regular_; }
  Columns solve(const Columns& R) override { return lu_.solve(R); }
  Column solve(const Column& r) override { return lu_.solve(r); }
  std::size_t bytes() const override { return std::size_t(lu_.nnzL() + lu_.nnzU()) * (sizeof(Scalar) + 4); }

 private:
  // With fewer than three digits of a known solution the matrix counts as singular. Its values have all digits: with
  // simple numbers what rounding leaves of a vanished pivot and of the right side can have the known quotient.
  bool finds_known_solution(const ScalarSparse& shifted) {
    Column u(shifted.rows());
    for (Index i = 0; i < u.size(); ++i) u[i] = (i % 3 == 0 ? -1 : 1) * (1.5 + std::sin(double(i) * double(i)));
    const Column found = lu_.solve(Column(shifted * u));
    return (found - u).cwiseAbs().maxCoeff() < 1e-3;
  }

  mutable Eigen::SparseLU<ScalarSparse> lu_;  ///< its counts of entries are not const
  bool regular_ = false;
};

template <class Scalar>
std::unique_ptr<ShiftedSystem<Scalar>> factorized(const SparseDynamics& d, Scalar z) {
  auto made = std::make_unique<SparseShift<Scalar>>(d, z);
  return made->regular() ? std::move(made) : nullptr;
}

}  // namespace

// Where E^{-1} E v is far from v, E is singular to rounding though no pivot vanished.
bool SparseSystem::has_singular_mass() const {
  if (!has_mass()) return false;
  SparseMatrix E = d.E;
  E.makeCompressed();
  Eigen::SparseLU<SparseMatrix> lu(E);
  if (lu.info() != Eigen::Success) return true;
  const Vector v = Vector::NullaryExpr(E.rows(), [](Index i) { return 1 + std::sin(double(i * i)); });
  const Vector found = lu.solve(Vector(E * v));
  return !((found - v).cwiseAbs().maxCoeff() <= 1e-2);
}

SparseMatrix SparseSystem::rates_of_inputs(double) const {
  if (!has_mass()) return d.B;
  SparseMatrix E = d.E;
  E.makeCompressed();
  const Eigen::SparseLU<SparseMatrix> lu(E);
  return Matrix(lu.solve(Matrix(d.B))).sparseView(0, 0);
}

Spectrum SparseSystem::spectrum() const {
  constexpr Index exact_size = 256;  // 25 m^3 operations: below a second
  if (d.A.rows() > exact_size) return d.E.rows() > 0 ? sparse_spectrum(d.A, d.E) : sparse_spectrum(d.A);
  return dense_spectrum({Matrix(d.A), {}, {}, Matrix(d.E)});
}

std::unique_ptr<ShiftedSystem<Complex>> SparseSystem::at_shift(Complex z) const { return factorized(d, z); }
std::unique_ptr<ShiftedSystem<double>> SparseSystem::at_shift(double z) const { return factorized(d, z); }

std::shared_ptr<const DenseDynamics> SparseSystem::dense_form() const {
  require_dense_size(d.A.rows());
  return std::make_shared<DenseDynamics>(DenseDynamics{Matrix(d.A), Matrix(d.B), Matrix(d.N), Matrix(d.E)});
}

ComplexMatrix SparseSystem::solve_at(const ComplexVector& nodes, const HostThreads& threads) const {
  return multifrontal::sparse_shifted_solves(d.A, d.E, d.B, d.N, nodes, threads);
}

std::shared_ptr<LinearSystem> linear_system(SparseDynamics d) { return std::make_shared<SparseSystem>(std::move(d)); }

}  // namespace bromwich
