#include "core/nonlinear/nonlinear_scene.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/dense.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// Column by column: the derivative by one argument.
template <class At>
void difference(const At& at, const Vector& around, Eigen::Ref<Matrix> by) {
  Vector z = around, above(by.rows()), below(by.rows());
  const double largest = around.size() > 0 ? around.cwiseAbs().maxCoeff() : 0, floor = largest > 0 ? largest : 1;
  for (Index k = 0; k < z.size(); ++k) {
    const double step = std::cbrt(epsilon) * std::max(std::abs(around[k]), 1e-3 * floor);
    z[k] = around[k] + step;
    const double up = z[k];
    at(z, above);
    z[k] = around[k] - step;
    const double down = z[k];
    at(z, below);
    z[k] = around[k];
    by.col(k) = (above - below) / (up - down);
  }
}

}  // namespace

void NonlinearScene::validate() const {
  linear.validate();
  const DenseDynamics* d = linear.dynamics->small_state();
  if (!d || d->E.size() > 0)
    throw Error("dynamics", "the linear part is not dense, or has a mass matrix", "write A, B and N as dense matrices");
  if (linear.boundary) throw Error("boundary", "the linear part has boundary values", "give x0");
  if (!linear.free_rows.empty()) throw Error("free_rows", "the linear part has free rows", "eliminate them");
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
  difference([&](const Vector& z, Eigen::Ref<Vector> v) { function(t, z, y, v); }, x, l.by_x);
  difference([&](const Vector& z, Eigen::Ref<Vector> v) { function(t, x, z, v); }, y, l.by_y);
  return l;
}

}  // namespace bromwich
