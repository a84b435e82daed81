// Dynamics supplied by callbacks against the same dynamics given as matrices.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>
#include <Eigen/SparseLU>

#include <atomic>
#include <cmath>
#include <memory>
#include <thread>

namespace bromwich {
namespace {

SuppliedDynamics supplied(const SparseDynamics& d) {
  SuppliedDynamics s;
  s.states = d.A.rows();
  s.B = d.B;
  s.N = d.N;
  s.shifted = [A = d.A, E = d.E](Complex z) -> ShiftedSolve {
    Eigen::SparseMatrix<Complex> shifted(A.rows(), A.cols());
    shifted.setIdentity();
    if (E.rows() > 0) shifted = E.cast<Complex>();
    shifted = z * shifted - A.cast<Complex>();
    shifted.makeCompressed();
    const auto lu = std::make_shared<Eigen::SparseLU<Eigen::SparseMatrix<Complex>>>(shifted);
    return [lu](const ComplexMatrix& R) -> ComplexMatrix { return lu->solve(R); };
  };
  if (d.E.rows() > 0) s.mass = [E = d.E](const Matrix& X) -> Matrix { return E * X; };
  return s;
}

Scene supplied_signorini() { return make_scene("signorini", {{"Q", 24}}); }

Result run_supplied(const Scene& scene, Method method, const std::vector<Index>& components = {}) {
  Options options;
  options.method = method;
  options.steps = 100;
  options.states = StateSelection::list;
  options.components = components;
  return solve(scene, *make_cpu_backend(2), options);
}

TEST(SuppliedDynamics, EveryMethodOfSparseDynamics) {
  Scene scene = supplied_signorini();
  const SparseDynamics sparse = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  scene.dynamics = sparse;
  Scene own = scene;
  own.dynamics = supplied(sparse);
  for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler, Method::automatic}) {
    const Result expected = run_supplied(scene, method, {0, 100}), found = run_supplied(own, method, {0, 100});
    ASSERT_EQ(expected.status, Status::solved) << expected.reason;
    ASSERT_EQ(found.status, Status::solved) << to_string(method) << ": " << found.reason;
    EXPECT_EQ(found.method, expected.method);
    EXPECT_LE((found.y - expected.y).cwiseAbs().maxCoeff(), 1e-9 * std::max(1.0, expected.y.cwiseAbs().maxCoeff()));
    EXPECT_LE((found.x - expected.x).cwiseAbs().maxCoeff(), 1e-9 * std::max(1.0, expected.x.cwiseAbs().maxCoeff()));
  }
}

TEST(SuppliedDynamics, WithAMassMatrix) {
  Scene scene = supplied_signorini();
  SparseDynamics sparse = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  sparse.E = SparseMatrix(sparse.A.rows(), sparse.A.cols());
  sparse.E.setIdentity();
  for (Index i = 0; i + 1 < sparse.A.rows(); ++i)
    sparse.E.coeffRef(i, i + 1) = sparse.E.coeffRef(i + 1, i) = 0.2 * std::sin(double(i));
  scene.dynamics = sparse;
  Scene own = scene;
  own.dynamics = supplied(sparse);
  for (const Method method : {Method::march, Method::euler}) {
    const Result expected = run_supplied(scene, method, {3}), found = run_supplied(own, method, {3});
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    EXPECT_LE((found.y - expected.y).cwiseAbs().maxCoeff(), 1e-9 * std::max(1.0, expected.y.cwiseAbs().maxCoeff()));
    EXPECT_LE((found.x - expected.x).cwiseAbs().maxCoeff(), 1e-9 * std::max(1.0, expected.x.cwiseAbs().maxCoeff()));
  }
}

// Two stages and impulses: E x changes by B times the impulse, whatever the unit of the equations.
TEST(SuppliedDynamics, RadauWithAMassMatrix) {
  Scene scene = supplied_signorini();
  SparseDynamics sparse = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  sparse.E = SparseMatrix(sparse.A.rows(), sparse.A.cols());
  sparse.E.setIdentity();
  for (Index i = 0; i + 1 < sparse.A.rows(); ++i) sparse.E.coeffRef(i, i + 1) = sparse.E.coeffRef(i + 1, i) = 0.2;
  sparse.N = -sparse.N;  // contact: y pushes what w sees
  scene.dynamics = sparse;
  scene.M = Matrix(Matrix::Zero(scene.constraints(), scene.constraints()));
  scene.lcp_class = LcpClass::PSD;
  scene.f = {};
  Scene own = scene, scaled = scene;
  own.dynamics = supplied(sparse);
  for (SparseMatrix* matrix : {&sparse.E, &sparse.A, &sparse.B}) *matrix *= 4;
  scaled.dynamics = sparse;
  const Result expected = run_supplied(scene, Method::march, {3});
  ASSERT_EQ(expected.status, Status::solved) << expected.reason;
  EXPECT_FALSE(expected.continuous);
  for (const Scene& same : {own, scaled}) {
    const Result found = run_supplied(same, Method::march, {3});
    ASSERT_EQ(found.status, Status::solved) << found.reason;
    EXPECT_LE((found.y - expected.y).cwiseAbs().maxCoeff(), 1e-9 * std::max(1.0, expected.y.cwiseAbs().maxCoeff()));
    EXPECT_LE((found.x - expected.x).cwiseAbs().maxCoeff(), 1e-9 * std::max(1.0, expected.x.cwiseAbs().maxCoeff()));
  }
}

TEST(SuppliedDynamics, CallbacksAreCalledFromTheCallingThreadUnlessTheyAreSafe) {
  Scene scene = supplied_signorini();
  SuppliedDynamics own = supplied(to_sparse(get<KroneckerDynamics>(scene.dynamics)));
  const auto elsewhere = std::make_shared<std::atomic<int>>(0);
  own.shifted = [inner = own.shifted, elsewhere, here = std::this_thread::get_id()](Complex z) {
    if (std::this_thread::get_id() != here) ++*elsewhere;
    return inner(z);
  };
  scene.dynamics = own;
  const Result once = run_supplied(scene, Method::march);
  EXPECT_EQ(*elsewhere, 0);
  own.thread_safe = true;
  scene.dynamics = own;
  EXPECT_LE((run_supplied(scene, Method::march).y - once.y).cwiseAbs().maxCoeff(), 1e-14);
}

TEST(SuppliedDynamics, AGivenBoundIsUsed) {
  Scene scene = supplied_signorini();
  SuppliedDynamics own = supplied(to_sparse(get<KroneckerDynamics>(scene.dynamics)));
  scene.dynamics = own;
  const Result estimated = run_supplied(scene, Method::march);
  own.bound = SpectralBound{0, 0};
  scene.dynamics = own;
  EXPECT_LE((run_supplied(scene, Method::march).y - estimated.y).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(SuppliedDynamics, WhatIsWrongIsSaid) {
  Scene scene = supplied_signorini();
  SuppliedDynamics own = supplied(to_sparse(get<KroneckerDynamics>(scene.dynamics)));
  own.shifted = {};
  scene.dynamics = own;
  EXPECT_NE(refusal([&] { scene.validate(); }).find("shifted"), std::string::npos);
  own.shifted = [](Complex) -> ShiftedSolve {
    return [](const ComplexMatrix& R) -> ComplexMatrix { return R.topRows(1); };
  };
  scene.dynamics = own;
  EXPECT_NE(refusal([&] { run_supplied(scene, Method::march); }).find("shifted"), std::string::npos);
  own.shifted = [](Complex) -> ShiftedSolve { throw std::runtime_error("the user's own words"); };
  scene.dynamics = own;
  EXPECT_THROW(run_supplied(scene, Method::march), std::runtime_error);
}

TEST(SuppliedDynamics, WhatNeedsMatricesIsRefused) {
  Scene scene = supplied_signorini();
  scene.dynamics = supplied(to_sparse(get<KroneckerDynamics>(scene.dynamics)));
  EXPECT_EQ(run_supplied(scene, Method::contour_literal).status, Status::unsupported);
  const Result result = run_supplied(scene, Method::march);
  EXPECT_NE(refusal([&] { states_at(scene, *make_cpu_backend(1), result, {3}); }).find("supplied"), std::string::npos);
  EXPECT_NE(refusal([&] { run_supplied(scene, Method::galerkin); }).find("known by their solves alone"),
            std::string::npos);
  scene.free_rows = {1};
  EXPECT_NE(refusal([&] { run_supplied(scene, Method::march); }).find("free_rows"), std::string::npos);
}

// Solves that return non-finite values: no contour, and no steps of the state.
TEST(SuppliedDynamics, SolvesThatFailEndWithAReason) {
  Scene scene = supplied_signorini();
  SuppliedDynamics own = supplied(to_sparse(get<KroneckerDynamics>(scene.dynamics)));
  own.bound = SpectralBound{0, 0};
  own.shifted = [](Complex) -> ShiftedSolve { return [](const ComplexMatrix& R) -> ComplexMatrix { return NAN * R; }; };
  scene.dynamics = own;
  EXPECT_NE(refusal([&] { run_supplied(scene, Method::march); }).find("steps"), std::string::npos);
}

}  // namespace
}  // namespace bromwich
