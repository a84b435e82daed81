#pragma once
// A scene, the problem that a user states:
//
//     x' = A x + B y + f(t),   0 <= y  ⊥  w = N x + M y + g(t) >= 0,   x(0) = x0,   0 <= t <= T.
//
// symbol  variable            shape    meaning
// A,B,N   Scene::dynamics     m x m, m x n, n x m   linear dynamics and how the constraints see and drive it
// M       Scene::M            n x n    complementarity matrix
// f, g    Scene::f, Scene::g  m or n, n              sources, functions of time
// x0, T   Scene::x0, Scene::T m, 1     initial state, final time (the unit of time is the user's)
//
// Instead of x(0) = x0 a scene may state E0 x(0) + ET x(T) = b, and rows of w = 0 with a free y_i (mixed problems).

#include "../base/time_function.hpp"
#include "../dynamics/dynamics.hpp"
#include "../lcp/matrix.hpp"
#include "../numerics/boundary_condition.hpp"
#include "labels.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// How f(t) enters: as an m-vector, as B phi(t) with an n-vector phi, or as F phi(t) with a k-vector phi. What is
/// stored and sampled is phi: a heat source that many cells share costs one number a time point.
enum class SourceEntry { state, through_B, through_F };

struct PortHamiltonian;  // core/scene/port_hamiltonian.hpp

struct Scene {
  std::string name;
  Dynamics dynamics;
  LcpMatrix M;
  LcpClass lcp_class = LcpClass::automatic;
  TimeFunction f;  ///< m values, or the n or k values of phi, see f_entry; empty = 0
  SourceEntry f_entry = SourceEntry::state;
  SparseMatrix F;  ///< m x k with f_entry through_F, otherwise empty
  TimeFunction g;  ///< n values; empty = 0
  /// Times in [0, T] at which f or g may jump or have a kink, increasing; values there are taken one-sidedly. Empty
  /// where they are smooth.
  std::vector<double> breakpoints;
  bool breakpoints_are_all = false;  ///< f and g are known to be smooth elsewhere; no others are searched
  bool no_pulses = false;            ///< f and g may have kinks and jumps elsewhere, but no pulses to be searched for
  Vector x0;                         ///< m; empty with a boundary condition
  std::optional<BoundaryCondition> boundary;
  std::vector<Index> free_rows;  ///< rows i with w_i = 0 and y_i of either sign, increasing
  /// The structure the dynamics were made from, where there is one; null otherwise. Such a scene may have no
  /// constraints (n = 0).
  std::shared_ptr<const PortHamiltonian> port;
  /// k for a scene made by relay_scene: y = (s, y+) has 2k components, relay i is at lambda_i = 1 - 2 y_i. Otherwise 0.
  Index relays = 0;
  double T = 1;
  Index default_steps = 400;

  Labels names, units;    ///< for output and messages only
  std::string time_unit;  ///< such as "s"; empty where none is given

  /// Exact solution where one is known: writes x (m) and y (n) at t.
  std::function<void(double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y)> exact;

  Index states() const;       ///< m
  Index constraints() const;  ///< n
  Index sources() const;      ///< length of what `f` writes: m, n or k

  /// Throws Error naming the first member whose size or value is wrong (shapes, NaN, T <= 0).
  void validate() const;
  /// The same for one part: x0; f, g and breakpoints.
  void validate_x0(const Vector&) const;
  void validate_sources() const;
};

/// The scene with A, B, N and E as dense matrices, see to_dense.
Scene written_out(Scene);

/// The scene on [t, t + length] alone, from the state x, with its clock set back to 0.
Scene part_of(const Scene&, double t, double length, const Vector& x);

/// F with f = F phi, m x sources(). Precondition: the dynamics of the scene are these.
Matrix source_matrix(const Scene&, const DenseDynamics&);

}  // namespace bromwich
