#include "bench/studies/boundary_euler.hpp"

#include "core/base/timer.hpp"
#include "core/galerkin/solvers.hpp"

#include <Eigen/LU>

#include <cmath>

namespace bromwich::app {

namespace {

/// The steps in the form of the Galerkin problem, for its solvers: one coefficient per step and constraint.
GalerkinProblem euler_problem(const Scene& scene, Index J) {
  const DenseDynamics d = to_dense(scene.dynamics);
  const Index m = d.A.rows(), n = d.B.cols();
  GalerkinProblem p;
  p.N = J;
  const double h = scene.T / double(J);
  p.t = Vector::LinSpaced(J + 1, 0, scene.T);
  const Matrix R = (Matrix::Identity(m, m) - h * d.A).inverse(), M = to_dense(scene.M);
  p.runs = {{0, J, {R, h * R * d.B, d.N * R, M + h * d.N * R * d.B, M}}};
  p.forcing = RowMatrix::Zero(J, m);
  p.q = RowMatrix::Zero(J, n);
  const Matrix from_f = h * R * source_matrix(scene, d);
  Vector f(scene.sources()), g(n);
  for (Index k = 0; k < J; ++k) {
    const double t = h * double(k + 1);
    if (scene.f) {
      scene.f(t, f);
      p.forcing.row(k) = (from_f * f).transpose();
    }
    if (scene.g) {
      scene.g(t, g);
      p.q.row(k) = g.transpose();
    }
  }
  p.q += p.forcing * d.N.transpose();
  p.boundary = boundary_of(scene);
  p.initial_value = !scene.boundary;
  return p;
}

}  // namespace

BoundaryEuler solve_by_boundary_euler(const Scene& scene, Backend& backend, Index J) {
  Timer timer;
  BoundaryEuler euler;
  const GalerkinProblem p = euler_problem(scene, J);
  GalerkinSolution s = p.initial_value ? march_galerkin(p, backend, {}) : exchange_active_sets(p, backend, {});
  if (s.status != Status::solved && !p.initial_value) {
    const std::string first = s.reason;
    s = damped_newton(p, backend, {}, RowMatrix::Zero(J, scene.constraints()));
    if (s.status != Status::solved) s.reason = first + "; " + s.reason;
  }
  euler.seconds = timer.lap();
  euler.iterations = s.iterations;
  euler.reason = s.reason;
  if (s.status != Status::solved) return euler;
  euler.residual = natural_residual(p, s.z, s.x);
  euler.solved = euler.residual <= 1e-9;
  if (!euler.solved) euler.reason = "its residual is " + std::to_string(euler.residual);
  euler.y = s.z;
  euler.x = s.x;
  return euler;
}

}  // namespace bromwich::app
