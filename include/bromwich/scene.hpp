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

#include "dynamics.hpp"
#include "lcp.hpp"
#include "memory.hpp"
#include "time_function.hpp"
#include "types.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// E0 x(0) + ET x(T) = b instead of x(0) = x0: initial values (I, 0), periodic (I, -I), separated or coupled ends.
struct BoundaryCondition {
  Matrix E0, ET;  ///< m x m
  Vector b;       ///< m
};

/// One text per component of x, y and w of the user's scene; each list is empty where the user gives none. Scenes that
/// stages of a solve make from it may have other components: a list may then have another length.
struct Labels {
  std::vector<std::string> x;  ///< m
  std::vector<std::string> y;  ///< n
  std::vector<std::string> w;  ///< n
};

/// Coulomb's friction on a circle. The rows first, first + 1 and first + 2 of y and w have, in place of 0 <= y ⊥ w >=
/// 0,
///
///     0 <= y_first ⊥ w_first >= 0,   |y_t| <= mu y_first,   y_t = -mu y_first w_t / |w_t| where w_t != 0
///
/// with y_t and w_t the other two: second-order cones (De Saxcé & Feng, Int. J. Engng. Sci. 29, 1991).
struct FrictionCone {
  Index first = 0;
  double mu = 0;
  bool given = false;  ///< w_first = 0 instead, which decides y_first: friction of a normal force that is known
};

/// How f(t) enters: as an m-vector, as B phi(t) with an n-vector phi, or as F phi(t) with a k-vector phi. What is
/// stored and sampled is phi: a heat source that many cells share costs one number a time point.
enum class SourceEntry { state, through_B, through_F };

struct PortHamiltonian;

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
  /// n coefficients e_i in [0, 1] of Newton's law of impact, or empty: 0. Where w_i reaches 0 with w_i' < 0, it leaves
  /// with w_i'+ = -e_i w_i'-. For rigid contact: y acts on the second derivative of w_i. Methods events, shooting and
  /// march (given steps) take it. March locates the impacts of all scenes that state it, with e = 0 too.
  Vector restitution;
  /// Rows with friction on a circle. Method march takes them, where they are contacts of a structure (mechanics.hpp).
  std::vector<FrictionCone> cones;
  /// Elements with memory. Method events takes them, and for periodic states shooting.
  std::vector<Memory> memories;
  std::vector<Index> free_rows;  ///< rows i with w_i = 0 and y_i of either sign, increasing
  /// The structure the dynamics were made from, where there is one; null otherwise. Such a scene may have no
  /// constraints (n = 0).
  std::shared_ptr<const PortHamiltonian> port;
  /// k for a scene made by relay_scene: y = (s, y+) has 2k components, relay i is at lambda_i = 1 - 2 y_i. Otherwise 0.
  Index relays = 0;
  double T = 1;
  /// Of a solve that names neither steps nor a tolerance: this tolerance; 0: these steps; both 0: a tolerance of 1e-3.
  double default_tolerance = 0;
  Index default_steps = 0;

  Labels names, units;    ///< for output and messages only
  std::string time_unit;  ///< such as "s"; empty where none is given

  /// Exact solution where one is known: writes x (m) and y (n) at t.
  std::function<void(double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y)> exact;

  Index states() const;       ///< m
  Index constraints() const;  ///< n
  Index sources() const;      ///< length of what `f` writes: m, n or k
  Index steps() const;        ///< of one grid, where only the scene can say it: default_steps, or 400

  /// Throws Error naming the first member whose size or value is wrong (shapes, NaN, T <= 0).
  void validate() const;
  /// The same for one part: x0; f, g and breakpoints.
  void validate_x0(const Vector&) const;
  void validate_sources() const;
};

// Linear port-Hamiltonian systems:
//
//     E x' = (J - R) Q x + B u(t),   output B^T Q x,   energy H(x) = x^T Q^T E x / 2,
//     dH/dt = u^T B^T Q x - (Q x)^T R (Q x):  power supplied by the ports minus dissipation.
//
// symbol  variable              shape   meaning
// E       PortHamiltonian::E    m x m   descriptor matrix, regular; empty = identity
// J, R    PortHamiltonian::J,R  m x m   structure (skew) and dissipation (symmetric, positive semidefinite)
// Q       PortHamiltonian::Q    m x m   energy, Q^T E symmetric and positive semidefinite; empty = identity
// B, u    PortHamiltonian::B,u  m x k   ports and their input

struct PortHamiltonian {
  SparseMatrix E, J, R, Q, B;
  TimeFunction u;             ///< k values; empty = 0
  std::vector<double> jumps;  ///< times where u is known to jump; others are searched

  Index states() const { return J.rows(); }
  Index ports() const { return B.cols(); }

  /// Throws Error naming the first member that breaks the structure: sizes, J + J^T = 0, R and Q^T E symmetric and
  /// positive semidefinite (to rounding, whatever the units of the rows), E regular. For a singular E it describes the
  /// system.
  void validate() const;

  SparseMatrix state_matrix() const;        ///< (J - R) Q
  SparseMatrix energy_matrix() const;       ///< Q^T E
  SparseMatrix dissipation_matrix() const;  ///< Q^T R Q
  SparseMatrix output_matrix() const;       ///< Q^T B; outputs are its transpose times x
  double energy(const Vector& x) const;     ///< H(x)
};

/// The system without complementarity as a scene: A = E^{-1} (J - R) Q, f = E^{-1} B u; dense up to 256 states,
/// Scene::port set, no constraints. Validates the structure.
Scene make_scene(PortHamiltonian port, const Vector& x0, double T);

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

/// The scene of a relay with k outputs: A m x m, B m x k, C k x m, f writes m values and e k; y has 2k components. An
/// empty f or e is 0, an empty bound 1. T, steps and the name are left for the caller. Throws Error where the shapes do
/// not fit.
Scene relay_scene(const Matrix& A, const Matrix& B, const Matrix& C, const TimeFunction& f, const Vector& x0,
                  const TimeFunction& e = {}, const TimeFunction& bound = {});
/// The relays beside n complementarity pairs 0 <= y perp N x + M y + g(t) >= 0 of their own: y has 2k + n components,
/// and B (m x n) is how the last n enter x'. Precondition: `relays` is a scene of relay_scene.
Scene with_pairs(Scene relays, const Matrix& B, const Matrix& N, const Matrix& M, const TimeFunction& g);

}  // namespace bromwich
