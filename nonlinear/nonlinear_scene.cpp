#include "nonlinear/nonlinear_scene.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/dense.hpp"
#include "core/scene/has_impacts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

const char* to_string(NonlinearMethod method) {
  switch (method) {
    case NonlinearMethod::automatic:
      return "automatic";
    case NonlinearMethod::march:
      return "march";
    case NonlinearMethod::iteration:
      return "iteration";
    case NonlinearMethod::newton:
      return "newton";
    case NonlinearMethod::pointwise:
      break;
  }
  return "pointwise";
}

namespace {

// Column by column: the derivative by one argument. `not_below`: entries that are not below it stay so.
template <class At>
void difference(const At& at, const Vector& around, double not_below, Eigen::Ref<Matrix> by) {
  Vector z = around, above(by.rows()), below(by.rows());
  const double largest = around.size() > 0 ? around.cwiseAbs().maxCoeff() : 0, floor = largest > 0 ? largest : 1;
  for (Index k = 0; k < z.size(); ++k) {
    const double step = std::cbrt(epsilon) * std::max(std::abs(around[k]), 1e-3 * floor);
    z[k] = around[k] + step;
    const double up = z[k];
    at(z, above);
    z[k] = around[k] - step;
    if (around[k] >= not_below) z[k] = std::max(z[k], not_below);
    const double down = z[k];
    at(z, below);
    z[k] = around[k];
    by.col(k) = (above - below) / (up - down);
  }
}

}  // namespace

void NonlinearScene::validate() const {
  linear.validate();
  if (linear.dynamics->has_mass())
    throw Error("dynamics", "the linear part has a mass matrix", "multiply the equations by its inverse");
  if (linear.boundary) throw Error("boundary", "the linear part has boundary values", "give x0");
  if (has_impacts(linear))
    throw Error("restitution", "is given to a nonlinear scene", "leave it out: its impacts are inelastic");
  if (!linear.cones.empty())
    throw Error("cones", "are given to a nonlinear scene", "leave them out: friction on circles is linear");
  if (!linear.memories.empty()) throw Error("memories", "are given to a nonlinear scene", "leave them out");
  if (!linear.free_rows.empty()) throw Error("free_rows", "the linear part has free rows", "eliminate them");
  if (linear.constraints() == 0)
    throw Error("dynamics", "the linear part has no constraints", "add one that is never active");
}

void take_f_as_values(Scene& scene) {
  if (scene.f && scene.f_entry != SourceEntry::state) {
    const SparseMatrix F = scene.f_entry == SourceEntry::through_B ? scene.dynamics->inputs() : scene.F;
    scene.f = [f = scene.f, F](double t, Eigen::Ref<Vector> value) {
      Vector entering(F.cols());
      f(t, entering);
      value = F * entering;
    };
  }
  scene.f_entry = SourceEntry::state;
  scene.F = SparseMatrix();
}

NonlinearScene in_states(NonlinearScene scene) {
  constexpr Index largest_written_out = 512;
  if (scene.linear.dynamics->matrices() && scene.linear.states() <= largest_written_out)
    scene.linear = written_out(std::move(scene.linear));
  const DenseDynamics* d = scene.linear.dynamics->small_state();
  if (d) take_f_as_values(scene.linear);
  if (!d || !scene.of_trace) return scene;
  scene.of_trace = false;
  const Matrix &N = d->N, &B = d->B;
  const auto of_v = [](NonlinearFunction& function, const Matrix& left, const Matrix& out) {
    if (function)
      function = [of = function, left, out](double t, const auto& x, const auto& y, Eigen::Ref<Vector> value) {
        Vector own(left.cols());
        of(t, out * x, y, own);
        value = left * own;
      };
  };
  const auto derivative_of_v = [](NonlinearDerivative& derivative, const Matrix& left, const Matrix& out) {
    if (derivative)
      derivative = [of = derivative, left, out](double t, const auto& x, const auto& y, Eigen::Ref<Matrix> by_x,
                                                Eigen::Ref<Matrix> by_y) {
        Matrix by_v(left.cols(), out.rows()), own(left.cols(), y.size());
        of(t, out * x, y, by_v, own);
        by_x = left * by_v * out;
        by_y = left * own;
      };
  };
  const Matrix identity = Matrix::Identity(N.rows(), N.rows());
  of_v(scene.phi, B, N);
  of_v(scene.gamma, identity, N);
  derivative_of_v(scene.dphi, B, N);
  derivative_of_v(scene.dgamma, identity, N);
  return scene;
}

Linearization linearize(const NonlinearFunction& function, const NonlinearDerivative& derivative, Index rows, double t,
                        const Vector& x, const Vector& y) {
  Linearization l{Vector::Zero(rows), Matrix::Zero(rows, x.size()), Matrix::Zero(rows, y.size())};
  if (!function) return l;
  function(t, x, y, l.value);
  if (derivative) {
    derivative(t, x, y, l.by_x, l.by_y);
    return l;
  }
  difference([&](const Vector& z, Eigen::Ref<Vector> v) { function(t, z, y, v); }, x, -INFINITY, l.by_x);
  difference([&](const Vector& z, Eigen::Ref<Vector> v) { function(t, x, z, v); }, y, 0, l.by_y);
  return l;
}

}  // namespace bromwich
