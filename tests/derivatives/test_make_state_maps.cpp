// State maps of one scene in three forms against steps of its dense matrices, and all of them transposed.

#include "derivatives/make_state_maps.hpp"

#include "core/kernel/discretise.hpp"
#include "cpu/cpu_backend.hpp"
#include "derivatives/contour_states.hpp"
#include "derivatives/kronecker_states.hpp"
#include "tests/derivatives/drawn_changes.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <string>

namespace bromwich::state_maps_test {
namespace {

using namespace derivative_test;

constexpr Index J = 70;  // several windows of contours

struct Maps {
  explicit Maps(const Scene& given)
      : scene(given), problem(discretise(scene, *backend, J, false, &family)), maps(make_state_maps(problem)) {}

  std::unique_ptr<Backend> backend = make_cpu_backend(2);
  Scene scene;
  GridFamily family;
  DiscreteProblem problem;
  std::unique_ptr<StateMaps> maps;
};

// x_j = e^{hA} x_{j-1} + L B u_{j-1} + R B u_j.
RowMatrix stepped(const DenseDynamics& d, double h, const Vector& x0, const RowMatrix& u) {
  const StepOperators step = step_operators(d.A, Rule::exponential, h, J);
  RowMatrix x(J + 1, x0.size());
  x.row(0) = x0.transpose();
  for (Index j = 1; j <= J; ++j)
    x.row(j) = (step.decay * x.row(j - 1).transpose() + step.left * d.B * u.row(j - 1).transpose() +
                step.right * d.B * u.row(j).transpose())
                   .transpose();
  return x;
}

// `exact`: relative to the largest value.
void expect_steps(const Scene& s, const DenseDynamics& dense, double exact, const std::string& where) {
  const Maps made(s);
  const StateMaps& maps = *made.maps;
  const Index n = s.constraints(), m = s.states();
  Random random(3);
  const Vector x0 = random.vector(m);
  const RowMatrix u = random.matrix(J + 1, n), of_x = random.matrix(J + 1, m), rho = random.matrix(J + 1, n);
  const RowMatrix x = maps.states(x0, u), expected = stepped(dense, s.T / double(J), x0, u);
  EXPECT_LE((x - expected).cwiseAbs().maxCoeff(), exact * expected.cwiseAbs().maxCoeff()) << where;
  const RowMatrix seen = maps.seen(x0),
                  free = stepped(dense, s.T / double(J), x0, RowMatrix::Zero(J + 1, n)) * dense.N.transpose();
  EXPECT_LE((seen - free).cwiseAbs().maxCoeff(), exact * free.cwiseAbs().maxCoeff()) << where;
  const auto [of_u, of_x0] = maps.states_transposed(of_x);
  EXPECT_NEAR(dot(of_x, x), dot(of_u, u) + of_x0.dot(x0), 1e-13 * of_x.norm() * x.norm()) << where;
  for (int again = 0; again < 2; ++again)  // with what the first call has prepared
    EXPECT_NEAR(dot(rho, seen), maps.seen_transposed(rho).dot(x0), 1e-13 * rho.norm() * seen.norm()) << where;
}

TEST(StateMaps, AreStepsOfTheState) {
  const Scene modes = warmed("signorini", 9);
  const DenseDynamics dense = to_dense(modes.dynamics);
  Scene other = modes;
  expect_steps(modes, dense, 1e-11, "Kronecker sum");
  other.dynamics = dense;
  expect_steps(other, dense, 1e-11, "dense");
  other.dynamics = to_sparse(get<KroneckerDynamics>(modes.dynamics));
  expect_steps(other, dense, 1e-9, "sparse");  // contours are accepted at 1e-9
}

// A is not symmetric, has an eigenvalue 0.5, and there is a mass matrix.
TEST(StateMaps, OfSparseDynamicsWithMass) {
  const Index m = 40, n = 3;
  Random random(5);
  Matrix A = Matrix::Zero(m, m), E = Matrix::Identity(m, m);
  for (Index i = 0; i < m; ++i) {
    A(i, i) = i == 0 ? 0.5 : -2 - 0.3 * double(i);
    E(i, i) = 1 + 0.02 * double(i);
    if (i + 1 < m) A(i, i + 1) = 0.4, E(i + 1, i) = 0.1;
  }
  const Matrix B = random.matrix(m, n), N = random.matrix(n, m);
  Scene s = warmed("signorini", 3);
  s.dynamics = SparseDynamics{A.sparseView(), B.sparseView(), N.sparseView(), E.sparseView()};
  s.x0 = Vector::Zero(m);
  expect_steps(s, DenseDynamics{E.inverse() * A, E.inverse() * B, N}, 1e-9, "mass");
}

TEST(StateMaps, OfCallbacksAreNotTransposed) {
  const Scene modes = warmed("signorini", 5);
  const SparseDynamics sparse = to_sparse(get<KroneckerDynamics>(modes.dynamics));
  const Matrix A = sparse.A;
  SuppliedDynamics d;
  d.states = A.rows(), d.B = sparse.B, d.N = sparse.N;
  d.shifted = [A](Complex z) -> ShiftedSolve {
    const ComplexMatrix inverse = (z * ComplexMatrix::Identity(A.rows(), A.rows()) - A.cast<Complex>()).inverse();
    return [inverse](const ComplexMatrix& R) { return ComplexMatrix(inverse * R); };
  };
  Scene s = modes;
  s.dynamics = d;
  const Maps made(s);
  const Vector x0 = Random(2).vector(A.rows());
  const RowMatrix rho = RowMatrix::Ones(J + 1, 5);
  EXPECT_LE((made.maps->seen(x0) - Maps(modes).maps->seen(x0)).cwiseAbs().maxCoeff(), 1e-9 * x0.norm());
  EXPECT_EQ(made.maps->seen_transposed(rho).size(), 0);
  EXPECT_NE(refusal([&] { made.maps->states_transposed(RowMatrix::Zero(J + 1, 25)); }).find("no gradient"),
            std::string::npos);
}

TEST(StateMaps, OfUndampedOscillationsAreRefused) {
  Scene s = warmed("signorini", 3);
  Matrix A = Matrix::Zero(2, 2);
  A(0, 1) = 200, A(1, 0) = -200;
  s.dynamics = SparseDynamics{A.sparseView(), Matrix::Ones(2, 3).sparseView(), Matrix::Ones(3, 2).sparseView()};
  s.x0 = Vector::Zero(2);
  EXPECT_NE(refusal([&] {
              const std::unique_ptr<Backend> backend = make_cpu_backend(1);
              GridFamily family;
              ContourStates(discretise(s, *backend, J, false, &family));
            }).find("spectrum"),
            std::string::npos);
}

// Of the parameters of a sum, by differences of its dense matrices.
TEST(KroneckerStates, ByTheParameters) {
  const Scene s = warmed("signorini", 5);
  const KroneckerDynamics& d = get<KroneckerDynamics>(s.dynamics);
  const double h = s.T / double(J), step = 1e-5;
  const KroneckerStates states(d, h);
  Random random(8);
  const Vector x0 = random.vector(25);
  const RowMatrix u = random.matrix(J + 1, 5);
  const auto at = [&](double by) {
    KroneckerDynamics other = d;
    other.along.diffusivity *= 1 + by, other.across.diffusivity *= 1 - 2 * by, other.across.decay += 3 * by;
    other.b *= 1 + 0.5 * by;
    return stepped(to_dense(Dynamics(other)), h, x0, u);
  };
  RowMatrix x;
  states.change({.face = 1, .across = -2, .decay = 3, .input = 0.5}, states.modes_of(x0), states.face().to_modes(u),
                &x);
  const RowMatrix difference = (at(step) - at(-step)) / (2 * step);
  EXPECT_LE((x - difference).cwiseAbs().maxCoeff(), 1e-8 * difference.cwiseAbs().maxCoeff());
}

}  // namespace
}  // namespace bromwich::state_maps_test
