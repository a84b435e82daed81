#pragma once
// A nonlinear complementarity system with its linear part apart (Wu, Chen, A parallel iterative algorithm for
// differential linear complementarity problems, (5.1)-(5.2)):
//
//     x' = A x + B y + f(t) + phi(t, x, y),   0 <= y  ⊥  w = N x + M y + g(t) + gamma(t, x, y) >= 0,   x(0) = x0.
//
// The split is free. Terms in A, B, N and M are discretised exactly in time, and the iteration freezes them (W = A).
// Terms in phi and gamma are taken as linear between the time points.
//
// In large scenes phi and gamma may be functions of what the constraints see, v = N x, and phi may enter through B:
//
//     x' = A x + B (y + phi(t, v, y)) + f(t),   0 <= y  ⊥  w = v + M y + g(t) + gamma(t, v, y) >= 0.
//
// Then no array has the size of the states at all time points.

#include "../core/scene/scene.hpp"

#include <functional>

namespace bromwich {

/// Writes phi (m values, or n through B) or gamma (n values) at t, x (m) or v (n), and y (n).
using NonlinearFunction = std::function<void(double t, const Eigen::Ref<const Vector>& x,
                                             const Eigen::Ref<const Vector>& y, Eigen::Ref<Vector> value)>;
/// Writes the derivatives of phi or gamma by x (m columns) or v (n columns), and by y (n columns).
using NonlinearDerivative =
    std::function<void(double t, const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& y,
                       Eigen::Ref<Matrix> by_x, Eigen::Ref<Matrix> by_y)>;

struct NonlinearScene {
  Scene linear;                      ///< the linear part, with x0, T, f, g; without E, boundary values and free rows
  NonlinearFunction phi, gamma;      ///< empty: 0
  NonlinearDerivative dphi, dgamma;  ///< empty: by central differences
  bool of_trace = false;             ///< phi and gamma are functions of v = N x, and phi enters through B

  /// Length of the argument x or v of phi and gamma, and of phi: m, or n with of_trace.
  Index seen() const { return of_trace ? linear.constraints() : linear.states(); }

  /// As Scene::validate; throws Error too for a mass matrix, boundary values and free rows.
  void validate() const;
};

/// f with m values, however it was stated.
void take_f_as_values(Scene&);

/// Scenes with dense matrices, and with sparse ones of up to 512 states, which are written out: phi and gamma as
/// functions of x, and f with m values. Others stay as they are.
NonlinearScene in_states(NonlinearScene);

/// phi or gamma at one point with its derivatives.
struct Linearization {
  Vector value;
  Matrix by_x, by_y;
};

/// Derivatives by central differences with steps of eps^{1/3} where none are given; zero for an empty function.
Linearization linearize(const NonlinearFunction&, const NonlinearDerivative&, Index rows, double t, const Vector& x,
                        const Vector& y);

}  // namespace bromwich
