// Dynamics of the user: known by shifted solves.

#include "core/dynamics/supplied.hpp"

#include "core/base/require.hpp"
#include "core/dynamics/spectrum.hpp"

#include <type_traits>

namespace bromwich {

namespace {

template <class Scalar>
class SuppliedShift final : public ShiftedSystem<Scalar> {
 public:
  using typename ShiftedSystem<Scalar>::Columns;
  using typename ShiftedSystem<Scalar>::Column;
  SuppliedShift(const SuppliedDynamics& d, Scalar z) : z_(z), solve_(d.shifted(z)) {}
  Columns solve(const Columns& R) override {
    const ComplexMatrix X = solve_(R.template cast<Complex>());
    if (X.rows() != R.rows() || X.cols() != R.cols())
      throw Error("shifted", text("returned %td x %td", X.rows(), X.cols()),
                  text("return %td x %td, as R has", R.rows(), R.cols()));
    if (!X.allFinite()) throw eigenvalue_at(z_);
    if constexpr (std::is_same_v<Scalar, Complex>)
      return X;
    else
      return X.real();
  }
  Column solve(const Column& r) override { return solve(Columns(r)); }
  std::size_t bytes() const override { return 0; }  // not known

 private:
  Complex z_;
  ShiftedSolve solve_;
};

class SuppliedSystem final : public SystemOf<SuppliedDynamics> {
 public:
  using SystemOf::SystemOf;

  Index states() const override { return d.states; }
  Index constraints() const override { return d.B.cols(); }
  void validate(bool without_constraints) const override {
    const Index m = d.states, n = d.B.cols();
    require_some("states", m, "states");
    if (!without_constraints) require_some("B", n, "columns");
    require_shape("B", d.B, m, n, "states x constraints");
    require_shape("N", d.N, n, m, "constraints x states");
    require_finite("B", d.B);
    require_finite("N", d.N);
    if (!d.shifted) throw Error("shifted", "is empty", "give a function that solves (zE - A) X = R");
  }

  SparseMatrix inputs() const override { return d.B; }
  SparseMatrix outputs() const override { return d.N; }
  std::shared_ptr<LinearSystem> with_inputs_and_outputs(const SparseMatrix& B, const SparseMatrix& N) const override {
    SuppliedDynamics other = d;
    other.B = B;
    other.N = N;
    return linear_system(std::move(other));
  }
  Vector observe(const Vector& x) const override { return d.N * x; }
  Vector observed_terms(const Vector& x) const override { return d.N.cwiseAbs() * x.cwiseAbs(); }

  bool has_mass() const override { return bool(d.mass); }
  Vector times_mass(const Vector& x) const override { return d.mass ? Vector(d.mass(x)) : x; }

  Spectrum spectrum() const override {
    if (!d.bound) return supplied_spectrum(d);
    Spectrum s;
    s.half_angle = d.bound->half_angle;
    s.abscissa = d.bound->abscissa;
    s.bound = true;
    return s;
  }

  std::unique_ptr<ShiftedSystem<Complex>> at_shift(Complex z) const override {
    return std::make_unique<SuppliedShift<Complex>>(d, z);
  }
  std::unique_ptr<ShiftedSystem<double>> at_shift(double z) const override {
    return std::make_unique<SuppliedShift<double>>(d, z);
  }

 private:
  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads& threads) const override {
    const Index n = d.N.rows(), k = d.B.cols();
    const ComplexMatrix B = Matrix(d.B).cast<Complex>();
    const Eigen::SparseMatrix<Complex> N = d.N.cast<Complex>();
    ComplexMatrix R(nodes.size(), n * k);
    share_each(d.thread_safe ? threads : HostThreads(), nodes.size(), [&](Index p) {
      const ComplexMatrix block = N * SuppliedShift<Complex>(d, nodes[p]).solve(B);
      for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < k; ++j) R(p, i * k + j) = block(i, j);
    });
    return R;
  }
};

}  // namespace

std::shared_ptr<LinearSystem> linear_system(SuppliedDynamics d) {
  return std::make_shared<SuppliedSystem>(std::move(d));
}

}  // namespace bromwich
