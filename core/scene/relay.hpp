#pragma once
// Relays: x' = A x + B lambda + f(t), lambda_i in -Sgn(C_i x + e_i(t)), Sgn(s) = 1 for s > 0, -1 for s < 0, [-1, 1] for
// s = 0.
//
// With y = (s, y+) and w = (y-, 1 - s), C x + e = y+ - y- and lambda = 1 - 2s this is a linear complementarity system
// of twice the size (Acary, Bonnefon, Brogliato, Nonsmooth Modeling and Simulation for Switched Circuits, chapter 2):
//
//     M = [[0, I], [-I, 0]],  N = [-C; 0],  B' = [-2B, 0],  f' = f + B 1,  g = (-e, 1).
//
// M is skew, hence positive semidefinite and not P. With bounds b_i(t) >= 0 of lambda, -b <= lambda <= b, the last w is
// b - s, lambda = b - 2s, f' = f + B b and g = (-e, b).

#include "scene.hpp"

namespace bromwich {

/// The scene of a relay with k outputs: A m x m, B m x k, C k x m, f writes m values and e k; y has 2k components. An
/// empty f or e is 0, an empty bound 1. T, steps and the name are left for the caller. Throws Error where the shapes do
/// not fit.
Scene relay_scene(const Matrix& A, const Matrix& B, const Matrix& C, const TimeFunction& f, const Vector& x0,
                  const TimeFunction& e = {}, const TimeFunction& bound = {});
/// The relays beside n complementarity pairs 0 <= y perp N x + M y + g(t) >= 0 of their own: y has 2k + n components,
/// and B (m x n) is how the last n enter x'. Precondition: `relays` is a scene of relay_scene.
Scene with_pairs(Scene relays, const Matrix& B, const Matrix& N, const Matrix& M, const TimeFunction& g);

}  // namespace bromwich
