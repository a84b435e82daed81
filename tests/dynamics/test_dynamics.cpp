// Every kind of dynamics, and one of this file, against its dense matrices.

#include "core/dynamics/dynamics.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/dense.hpp"
#include "core/dynamics/kronecker.hpp"
#include "core/dynamics/linear_system.hpp"
#include "core/dynamics/small_resolvent.hpp"
#include "core/dynamics/sparse.hpp"
#include "core/dynamics/sparse_solves.hpp"
#include "core/dynamics/spectrum.hpp"
#include "core/dynamics/supplied.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

namespace bromwich {
namespace {

/// A = diag(rates): a kind of dynamics that the library does not know.
class Diagonal final : public LinearSystem {
 public:
  Diagonal(Vector rates, SparseMatrix B, SparseMatrix N)
      : rates_(std::move(rates)), B_(std::move(B)), N_(std::move(N)) {}

  Index states() const override { return rates_.size(); }
  Index constraints() const override { return B_.cols(); }
  void validate(bool) const override {
    if (rates_.size() == 0) throw Error("rates", "has no entries", "give at least one");
  }
  SparseMatrix inputs() const override { return B_; }
  SparseMatrix outputs() const override { return N_; }
  std::shared_ptr<LinearSystem> with_inputs_and_outputs(const SparseMatrix& B, const SparseMatrix& N) const override {
    return std::make_shared<Diagonal>(rates_, B, N);
  }
  Vector observe(const Vector& x) const override { return N_ * x; }
  Vector observed_terms(const Vector& x) const override { return N_.cwiseAbs() * x.cwiseAbs(); }
  Spectrum spectrum() const override {
    Spectrum s;
    s.abscissa = rates_.maxCoeff();
    s.radius = rates_.cwiseAbs().maxCoeff();
    return s;
  }
  std::unique_ptr<ShiftedSystem<Complex>> at_shift(Complex z) const override {
    return std::make_unique<Shift<Complex>>(rates_, z);
  }
  std::unique_ptr<ShiftedSystem<double>> at_shift(double z) const override {
    return std::make_unique<Shift<double>>(rates_, z);
  }

 private:
  template <class Scalar>
  struct Shift final : ShiftedSystem<Scalar> {
    using typename ShiftedSystem<Scalar>::Columns;
    using typename ShiftedSystem<Scalar>::Column;
    Shift(const Vector& rates, Scalar z) : inverse((z - rates.array().template cast<Scalar>()).inverse()) {}
    Columns solve(const Columns& R) override { return inverse.asDiagonal() * R; }
    Column solve(const Column& r) override { return inverse.asDiagonal() * r; }
    std::size_t bytes() const override { return sizeof(Scalar) * std::size_t(inverse.size()); }
    Column inverse;
  };

  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads&) const override {
    const ComplexMatrix B = Matrix(B_).cast<Complex>();
    ComplexMatrix R(nodes.size(), N_.rows() * B.cols());
    for (Index p = 0; p < nodes.size(); ++p) {
      const RowMatrix block = Matrix(N_) * Matrix((Shift<Complex>(rates_, nodes[p]).solve(B)).real());
      const RowMatrix other = Matrix(N_) * Matrix((Shift<Complex>(rates_, nodes[p]).solve(B)).imag());
      for (Index k = 0; k < block.size(); ++k) R(p, k) = Complex(block.data()[k], other.data()[k]);
    }
    return R;
  }

  Vector rates_;
  SparseMatrix B_, N_;
};

Matrix wave(Index rows, Index cols, double step) {
  return Matrix::NullaryExpr(rows, cols, [step](Index i, Index j) { return std::sin(step * double(1 + i + 3 * j)); });
}

/// The same dynamics of five states in this kind, and as dense matrices.
struct Pair {
  const char* name;
  Dynamics dynamics;
  DenseDynamics dense;
};

SuppliedDynamics supplied(const DenseDynamics& d) {
  SuppliedDynamics s;
  s.states = d.A.rows();
  s.B = d.B.sparseView();
  s.N = d.N.sparseView();
  s.shifted = [d](Complex z) -> ShiftedSolve {
    const ComplexMatrix shifted = z * d.E.cast<Complex>() - d.A.cast<Complex>();
    return [lu = Eigen::PartialPivLU<ComplexMatrix>(shifted)](const ComplexMatrix& R) -> ComplexMatrix {
      return lu.solve(R);
    };
  };
  s.mass = [E = d.E](const Matrix& X) -> Matrix { return E * X; };
  return s;
}

std::vector<Pair> every_kind() {
  const Index m = 6, n = 2;
  DenseDynamics d{wave(m, m, 0.7) - Matrix(3 * Matrix::Identity(m, m)), wave(m, n, 1.3), wave(n, m, 0.4)};
  std::vector<Pair> all{{"dense", d, d}};
  d.E = Matrix::Identity(m, m) + 0.1 * wave(m, m, 0.9);
  all.push_back({"dense with mass", d, d});
  all.push_back(
      {"sparse with mass", SparseDynamics{d.A.sparseView(), d.B.sparseView(), d.N.sparseView(), d.E.sparseView()}, d});
  all.push_back({"supplied", supplied(d), d});
  const KroneckerDynamics k{{2, 0.3, 0.5}, {3, 0.2, 0.4}, Vector{{1, 0.5, 0}}, Vector{{-1, 0.25, 0}}};
  const SparseDynamics written = to_sparse(k);
  all.push_back({"Kronecker sum", k, {Matrix(written.A), Matrix(written.B), Matrix(written.N)}});
  KroneckerDynamics box{{1, 0.3, 0.5}, {3, 0.2, 0.4}, Vector{{1, 0.5, 0}}, Vector{{-1, 0.25, 0}}};
  box.beside = {{2, 0.25, 0.7}};
  const SparseDynamics of_box = to_sparse(box);
  all.push_back({"box", box, {Matrix(of_box.A), Matrix(of_box.B), Matrix(of_box.N)}});
  const Vector rates = Vector::LinSpaced(m, -6, -1);
  all.push_back({"of this test",
                 Dynamics(std::make_shared<Diagonal>(rates, d.B.sparseView(), d.N.sparseView())),
                 {rates.asDiagonal(), d.B, d.N}});
  return all;
}

Matrix mass_of(const DenseDynamics& d) {
  return d.E.rows() > 0 ? d.E : Matrix(Matrix::Identity(d.A.rows(), d.A.rows()));
}

// Small matrices with condition numbers below 1e3: rounding errors stay below 1e3 eps.
constexpr double rounding = 1e-12;

TEST(Dynamics, SizesInputsAndOutputs) {
  for (const Pair& p : every_kind()) {
    SCOPED_TRACE(p.name);
    const Vector x = wave(p.dense.A.rows(), 1, 1.1);
    EXPECT_NO_THROW(p.dynamics->validate(false));
    EXPECT_EQ(states(p.dynamics), p.dense.A.rows());
    EXPECT_EQ(constraints(p.dynamics), p.dense.B.cols());
    EXPECT_EQ(Matrix(p.dynamics->inputs()), p.dense.B);
    EXPECT_EQ(Matrix(p.dynamics->outputs()), p.dense.N);
    EXPECT_LE((observe(p.dynamics, x) - p.dense.N * x).norm(), rounding);
    EXPECT_LE((p.dynamics->observed_terms(x) - p.dense.N.cwiseAbs() * x.cwiseAbs()).norm(), rounding);
    EXPECT_EQ(p.dynamics->has_mass(), p.dense.E.rows() > 0);
    EXPECT_LE((p.dynamics->times_mass(x) - mass_of(p.dense) * x).norm(), rounding);
    EXPECT_FALSE(p.dynamics->has_singular_mass());
    if (p.dynamics->has_matrices()) {
      EXPECT_EQ(to_dense(p.dynamics).A, p.dense.A);
      EXPECT_EQ(to_dense(p.dynamics).E, p.dense.E);
    } else {
      EXPECT_NE(refusal([&] { to_dense(p.dynamics); }).find("known by their solves alone"), std::string::npos);
    }
  }
}

TEST(Dynamics, SolvesOfShifts) {
  const ComplexVector nodes{{Complex(1, 2), Complex(0.3, -4), Complex(5, 0)}};
  for (const Pair& p : every_kind()) {
    SCOPED_TRACE(p.name);
    const Matrix E = mass_of(p.dense), R = wave(E.rows(), 3, 0.6);
    const ComplexMatrix found = p.dynamics->shifted_solves(nodes, HostThreads());
    for (Index k = 0; k < nodes.size(); ++k) {
      const ComplexMatrix inverse = (nodes[k] * E.cast<Complex>() - p.dense.A.cast<Complex>()).inverse();
      const ComplexMatrix block = p.dense.N.cast<Complex>() * inverse * p.dense.B.cast<Complex>();
      if (!p.dynamics->modes()) {  // modal values: tests/backends/test_backend.cpp
        EXPECT_LE((found.row(k) - block.reshaped<Eigen::RowMajor>().transpose()).norm(), rounding);
      }
      const ComplexMatrix columns = R.cast<Complex>();
      EXPECT_LE((p.dynamics->at_shift(nodes[k])->solve(columns) - inverse * columns).norm(), rounding);
    }
    EXPECT_LE((p.dynamics->at_shift(2.0)->solve(R) - (2 * E - p.dense.A).inverse() * R).norm(), rounding);
    // The default of the interface is exact to |A| / z, z = 1e6 / h; an implementation of its own to rounding.
    EXPECT_LE((Matrix(p.dynamics->rates_of_inputs(1)) - E.inverse() * p.dense.B).norm(), 1e-4);
  }
}

TEST(Dynamics, SpectrumHoldsTheEigenvalues) {
  for (const Pair& p : every_kind()) {
    SCOPED_TRACE(p.name);
    const Spectrum exact = dense_spectrum(p.dense), found = spectrum(p.dynamics);
    EXPECT_GE(found.abscissa, exact.abscissa - rounding);
    EXPECT_LE(std::abs(found.radius - exact.radius), 1e-6 * exact.radius);
  }
}

TEST(Dynamics, OtherInputsAndOutputs) {
  for (const Pair& p : every_kind()) {
    SCOPED_TRACE(p.name);
    const SparseMatrix B = wave(p.dense.A.rows(), 3, 0.2).sparseView(), N = wave(1, p.dense.A.rows(), 0.8).sparseView();
    if (p.dynamics->modes()) {
      EXPECT_NE(refusal([&] { p.dynamics->with_inputs_and_outputs(B, N); }).find("are a Kronecker sum"),
                std::string::npos);
      continue;
    }
    const Dynamics other(p.dynamics->with_inputs_and_outputs(B, N));
    EXPECT_EQ(Matrix(other->inputs()), Matrix(B));
    EXPECT_EQ(Matrix(other->outputs()), Matrix(N));
    EXPECT_LE((other->at_shift(2.0)->solve(Matrix(B)) - p.dynamics->at_shift(2.0)->solve(Matrix(B))).norm(), rounding);
  }
}

// Of a singular zE - A.
TEST(Dynamics, EigenvaluesAreFound) {
  const DenseDynamics d{Matrix{{1, 0}, {0, -2}}, Matrix{{1}, {1}}, Matrix{{1, 1}}};
  const SparseDynamics s{d.A.sparseView(), d.B.sparseView(), d.N.sparseView()};
  const ComplexVector at{{Complex(1, 0)}};
  EXPECT_THROW(Dynamics(d)->shifted_solves(at, HostThreads()), SingularShift);
  EXPECT_THROW(Dynamics(s)->shifted_solves(at, HostThreads()), SingularShift);
  EXPECT_EQ(Dynamics(s)->at_shift(1.0), nullptr);
}

TEST(Dynamics, CopiesAreValues) {
  Dynamics a = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  const Dynamics b = a;
  EXPECT_EQ(&*a, &*b);  // shared as long as none is changed
  DenseDynamics& of_a = get<DenseDynamics>(a);
  const Dynamics c = a;
  of_a.A(0, 0) = -2;
  EXPECT_EQ(to_dense(a).A(0, 0), -2);
  EXPECT_EQ(to_dense(b).A(0, 0), -1);
  EXPECT_EQ(to_dense(c).A(0, 0), -1);
  EXPECT_EQ(get_if<SparseDynamics>(&a), nullptr);
  EXPECT_NE(refusal([&] { get<SparseDynamics>(a); }).find("of another kind"), std::string::npos);
}

// A kind of its own goes through the methods that need solves alone.
TEST(Dynamics, AKindOfOnesOwnIsSolved) {
  Scene scene;
  scene.name = "diagonal";
  const Vector rates{{-3, -1, -0.2}};
  const DenseDynamics dense{rates.asDiagonal(), Matrix{{1, 0}, {0.5, 1}, {0, 2}}, Matrix{{1, 0.5, 0}, {0, 1, 2}}};
  scene.M = Matrix{{1, 0.2}, {0.2, 2}};
  scene.x0 = Vector{{1, -2, 0.5}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << std::sin(5 * t), -std::cos(3 * t); };
  scene.T = 2;
  Options options;
  options.steps = 80;
  for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler}) {
    SCOPED_TRACE(to_string(method));
    options.method = method;
    scene.dynamics = dense;
    const auto backend = make_cpu_backend(1);
    const Result expected = solve(scene, *backend, options);
    scene.dynamics = Dynamics(std::make_shared<Diagonal>(rates, dense.B.sparseView(), dense.N.sparseView()));
    const Result found = solve(scene, *backend, options);
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    // Weights from contours are accurate to 1e-9, and the iterations stop at 1e-10.
    EXPECT_LE((found.y - expected.y).cwiseAbs().maxCoeff(), 1e-8);
  }
}

/// N (zI - A)^{-1} B of one node, row by row.
Eigen::RowVectorXcd resolvent_by_lu(const Matrix& A, const Matrix& B, const Matrix& N, Complex z) {
  const ComplexMatrix shifted = z * ComplexMatrix::Identity(A.rows(), A.rows()) - A.cast<Complex>();
  const ComplexMatrix X = N.cast<Complex>() * shifted.fullPivLu().solve(B.cast<Complex>());
  return X.transpose().reshaped().transpose();
}

TEST(SmallResolvent, EqualsFullPivoting) {
  for (const Index m : {1, 2, 3, 5, 16})
    for (const auto& [n, k, count] : {std::tuple<Index, Index, Index>{1, 1, 1}, {3, 2, 8}, {2, 3, 11}}) {
      reference::Random random{std::uint32_t(100 * m + count)};
      const Matrix A = random.matrix(m, m), B = random.matrix(m, k), N = random.matrix(n, m);
      const double size = A.norm();
      ComplexVector nodes(count);
      for (Index p = 0; p < count; ++p) nodes[p] = std::polar(2 * size, 0.3 + 0.5 * double(p));
      const ComplexMatrix R = small_resolvent(A, B, N, nodes);
      // |(zI - A)^{-1}| <= 1/|A|, its condition <= 3; m^2 roundings in each of three products and the elimination.
      const double allowed = 12 * double(m * m + 4) * epsilon * N.norm() * B.norm() / size;
      for (Index p = 0; p < count; ++p)
        EXPECT_LE((R.row(p) - resolvent_by_lu(A, B, N, nodes[p])).cwiseAbs().maxCoeff(), allowed) << m << ' ' << p;
    }
}

// Every diagonal entry is zero: rows have to be exchanged. One node is an eigenvalue.
TEST(SmallResolvent, ExchangesRows) {
  Matrix A = Matrix::Zero(4, 4);
  A(0, 1) = A(1, 2) = A(2, 3) = A(3, 0) = 1;
  const Matrix I = Matrix::Identity(4, 4);
  const ComplexVector nodes{{0, Complex(0, 1e-9), 1}};
  const ComplexMatrix R = small_resolvent(A, I, I, nodes);
  // (zI - A)^{-1} = -A^3 (1 - z A^3)^{-1}: to first order in z, -A^3 - z A^6.
  const Matrix A3 = A * A * A, A6 = A3 * A3;
  for (Index i = 0; i < 4; ++i)
    for (Index j = 0; j < 4; ++j) {
      EXPECT_LE(std::abs(R(0, 4 * i + j) + A3(i, j)), 8 * epsilon);
      EXPECT_LE(std::abs(R(1, 4 * i + j) + A3(i, j) + nodes[1] * A6(i, j)), 8 * epsilon + 1e-18);
    }
  EXPECT_FALSE(R.row(2).allFinite());
}

}  // namespace
}  // namespace bromwich
