// Dense dynamics: the state is stepped as a whole.

#include "core/dynamics/dense.hpp"

#include "core/dynamics/matrix_system.hpp"
#include "core/dynamics/small_resolvent.hpp"
#include "core/dynamics/spectrum.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_together = 16;  ///< states up to which one thread takes all nodes

template <class Scalar>
class DenseShift final : public ShiftedSystem<Scalar> {
 public:
  using typename ShiftedSystem<Scalar>::Columns;
  using typename ShiftedSystem<Scalar>::Column;
  DenseShift(const DenseDynamics& d, Scalar z) {
    Columns shifted = -d.A.cast<Scalar>();
    if (d.E.rows() > 0)
      shifted += z * d.E.cast<Scalar>();
    else
      shifted.diagonal().array() += z;
    lu_.compute(shifted);
  }
  Columns solve(const Columns& R) override { return lu_.solve(R); }
  Column solve(const Column& r) override { return lu_.solve(r); }
  std::size_t bytes() const override { return sizeof(Scalar) * std::size_t(lu_.matrixLU().size()); }

 private:
  Eigen::PartialPivLU<Columns> lu_;
};

class DenseSystem final : public MatrixSystem<DenseDynamics> {
 public:
  using MatrixSystem::MatrixSystem;

  SparseMatrix inputs() const override { return d.B.sparseView(); }
  SparseMatrix outputs() const override { return d.N.sparseView(); }

  bool has_singular_mass() const override {
    return has_mass() && !(reciprocal_condition(Eigen::PartialPivLU<Matrix>(scaled(d.E, equilibrate(d.E)))) > epsilon);
  }

  Spectrum spectrum() const override { return dense_spectrum(d); }

  std::unique_ptr<ShiftedSystem<Complex>> at_shift(Complex z) const override {
    return std::make_unique<DenseShift<Complex>>(d, z);
  }
  std::unique_ptr<ShiftedSystem<double>> at_shift(double z) const override {
    return std::make_unique<DenseShift<double>>(d, z);
  }

  const DenseDynamics* small_state() const override { return &d; }
  std::shared_ptr<const DenseDynamics> dense_form() const override { return {std::shared_ptr<void>(), &d}; }

 private:
  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads& threads) const override {
    const Index n = d.N.rows(), k = d.B.cols();
    const bool small = d.A.rows() <= most_together;
    if (small && d.E.rows() == 0) return small_resolvent(d.A, d.B, d.N, nodes);
    ComplexMatrix R(nodes.size(), n * k);
    const Index together = small ? nodes.size() : 1;
    const ComplexMatrix N = d.N.cast<Complex>(), B = d.B.cast<Complex>();
    share(threads, nodes.size(), std::max<Index>(together, 1), [&](Index first, Index last) {
      for (Index p = first; p < last; ++p) {
        const ComplexMatrix block = N * DenseShift<Complex>(d, nodes[p]).solve(B);
        for (Index i = 0; i < n; ++i)
          for (Index j = 0; j < k; ++j) R(p, i * k + j) = block(i, j);
      }
    });
    return R;
  }
};

}  // namespace

std::shared_ptr<LinearSystem> linear_system(DenseDynamics d) { return std::make_shared<DenseSystem>(std::move(d)); }

Spectrum dense_spectrum(const DenseDynamics& d) {
  Spectrum s;
  if (d.E.rows() > 0) {
    const Matrix A = d.E.partialPivLu().solve(d.A);
    return A.allFinite() ? dense_spectrum({A, {}, {}}) : s;
  }
  if (d.A.rows() == 0) return s;
  const ComplexVector eigenvalues = Eigen::EigenSolver<Matrix>(d.A, false).eigenvalues();
  s.non_normal = (d.A * d.A.transpose() - d.A.transpose() * d.A).norm() > 0.1 * d.A.squaredNorm();
  s.radius = eigenvalues.cwiseAbs().maxCoeff();
  s.abscissa = eigenvalues.real().maxCoeff();
  // The QR algorithm has an error of about eps ||A||: smaller eigenvalues and imaginary parts are set to zero.
  const double rounding = 16 * epsilon * d.A.norm();
  for (const Complex lambda : eigenvalues) {
    if (std::abs(lambda) <= rounding) continue;
    s.slowest = s.slowest == 0 ? std::abs(lambda) : std::min(s.slowest, std::abs(lambda));
    const double angle = std::abs(std::arg(-lambda));
    if (std::abs(lambda.imag()) > rounding || lambda.real() > 0) s.half_angle = std::max(s.half_angle, angle);
  }
  return s;
}

}  // namespace bromwich
