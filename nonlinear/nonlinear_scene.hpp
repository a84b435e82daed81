#pragma once

#include "../core/scene/scene.hpp"
#include "bromwich/nonlinear.hpp"

namespace bromwich {

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
