#pragma once
// A nonlinear complementarity system with its linear part apart (Wu, Zhou, Chen, Laplace inversion of dynamic linear
// complementarity problems, (5.1)-(5.2)):
//
//     x' = A x + B y + f(t) + phi(t, x, y),   0 <= y  ⊥  w = N x + M y + g(t) + gamma(t, x, y) >= 0,   x(0) = x0.
//
// The split is free. What stands in A, B, N and M is discretised exactly in time and is what the iteration freezes (W =
// A); what stands in phi and gamma is taken as linear between the time points.

#include "../scene/scene.hpp"

#include <functional>

namespace bromwich {

/// Writes phi (m values) or gamma (n values) at t, x (m) and y (n).
using NonlinearFunction = std::function<void(double t, const Eigen::Ref<const Vector>& x,
                                             const Eigen::Ref<const Vector>& y, Eigen::Ref<Vector> value)>;
/// Writes the derivatives of phi or gamma by x (columns m) and by y (columns n).
using NonlinearDerivative =
    std::function<void(double t, const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& y,
                       Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y)>;

struct NonlinearScene {
  Scene linear;                      ///< the linear part, with x0, T, f, g; dense dynamics, without E
  NonlinearFunction phi, gamma;      ///< empty: 0
  NonlinearDerivative dphi, dgamma;  ///< empty: by central differences

  /// As Scene::validate; throws Error too for dynamics that are not dense, boundary values and free rows.
  void validate() const;
};

/// phi or gamma at one point with its derivatives.
struct Linearization {
  Vector value;
  Matrix by_x, by_y;
};

/// Derivatives by central differences with steps of eps^{1/3} where none are given; zero for an empty function.
Linearization linearize(const NonlinearFunction&, const NonlinearDerivative&, Index rows, double t, const Vector& x,
                        const Vector& y);

}  // namespace bromwich
