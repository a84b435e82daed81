#pragma once
// Reconstruction of x by a one-step scheme between its time points a = x_{i-1}, b = x_i, and the quadrature over a
// step. With s = (t - t_{i-1})/h
//
//     x(t) = alpha a + beta b + h (gamma a' + delta b'),   x' = A x + F u with u(t_{i-1}^+) and u(t_i^-)
//
//     Euler        alpha = 0, beta = 1: constant, the value at the right end; one node there
//     midpoint     linear; two Gauss nodes, exact for the quadratic terms of an energy balance
//     exponential  the cubic through both values and slopes; three Gauss nodes

#include "../host/step_chain.hpp"
#include "../scene/input_samples.hpp"
#include "../scene/port_hamiltonian.hpp"

#include <optional>

namespace bromwich {

struct Reconstruction {
  double alpha = 0, beta = 1, gamma = 0, delta = 0;
};
Reconstruction reconstruction(StepScheme, double s);

struct Quadrature {
  std::vector<double> nodes, weights;  ///< on [0, 1]
};
const Quadrature& quadrature(StepScheme);

/// The order in h of the reconstruction of a smooth solution from exact values at the time points, or of the scheme if
/// that is lower: 1, 2, 4.
int order(StepScheme);
const char* to_string(StepScheme);

/// A port-Hamiltonian system in the form that the schemes use, from the scene's dynamics or those of the port.
class PortSystem {
 public:
  /// Form of the steps: with A = E^{-1} (J - R) Q, or with E and (J - R) Q, which remain sparse if A does not.
  /// `automatic` keeps E for a sparse system whose E is not diagonal.
  enum class Form { automatic, state_space };

  PortSystem(const PortHamiltonian& port, double T, Form = Form::automatic);

  const PortHamiltonian& port() const { return port_; }
  Index states() const { return port_.states(); }
  double T() const { return T_; }
  const SparseMatrix& A() const { return space().A; }  ///< made on first use
  const SparseMatrix& F() const { return space().F; }  ///< E^{-1} B
  const SparseMatrix& energy_matrix() const { return energy_; }
  const SparseMatrix& dissipation_matrix() const { return dissipation_; }
  const SparseMatrix& output_matrix() const { return output_; }
  /// A in the form that the steps use: dense up to 64 states, sparse above (exponential: always dense).
  StepMatrix step_matrix(StepScheme) const;
  /// All steps of a grid, S_i x_i = R_i x_{i-1} + d_i with the d of step_sources. Implicit Euler has S = I - hA and R =
  /// I or, with E kept, S = E - h (J - R) Q and R = E; the other schemes likewise.
  StepChainProblem step_problem(StepScheme, const StepSizes&) const;
  bool keeps_E(StepScheme) const;
  bool dense_steps(StepScheme) const;

  double memory_limit = 0;  ///< bytes that products of steps may take; 0 = as StepChainProblem has it

  /// M x k: u at fraction s of every step; at its ends the limits from inside. u is evaluated only at times that the
  /// last two grids with this s did not contain.
  RowMatrix inputs(const Vector& t, double s) const;

 private:
  const StateSpace& space() const;

  PortHamiltonian port_;
  double T_;
  bool keeps_E_;
  mutable std::optional<StateSpace> space_;
  SparseMatrix energy_, dissipation_, output_;
  mutable InputSamples samples_;
};

struct ConstraintPath;  // core/goal/constrained_path.hpp
class HostThreads;

/// x at the time points of a grid, as computed by a scheme. `per_cell` consecutive steps form a cell (1, or 2 if the
/// cells of a coarser grid are halved); quantities use the energy balance of cells.
struct Trajectory {
  const PortSystem& system;
  StepScheme scheme;
  const Vector& t;     ///< M+1
  const RowMatrix& x;  ///< (M+1) x m
  Index per_cell = 1;
  const ConstraintPath* constraints = nullptr;  ///< y of scenes with complementarity
  const HostThreads* threads = nullptr;         ///< for work on the path; null: the calling thread only

  Index steps() const { return t.size() - 1; }
  Index cells() const { return steps() / per_cell; }
  double h(Index i) const { return t[i + 1] - t[i]; }  ///< of the step from t_i to t_{i+1}
  Vector lengths() const { return t.tail(steps()) - t.head(steps()); }
};

/// x' at the left ends of all steps (right limit of u) or at their right ends (left limit of u): M x m.
RowMatrix slopes(const Trajectory&, Side);

/// M x m: x at fraction s of every step. Only the exponential scheme needs the slopes.
RowMatrix states_within(const Trajectory&, double s);

/// Adds the derivative of Σ_i g_i^T x(t_{i-1} + s h_i) to `gradient`, (M+1) x m; g is M x m.
void add_within(const Trajectory&, double s, const RowMatrix& g, RowMatrix& gradient);

/// d_0 = x0 and d_i of S_i x_i = R_i x_{i-1} + d_i: Euler h F u(t_i^-), midpoint h F u at the middle (with E kept h B
/// u), exponential with u linear on the step. (M+1) x m.
RowMatrix step_sources(const PortSystem&, StepScheme, const Vector& t, const Vector& x0, const HostThreads* = nullptr);

/// The grid with every step halved, and the reconstruction of x on it: 2M+1 times, (2M+1) x m.
Vector halved(const Vector& t);
RowMatrix prolonged(const Trajectory&);

}  // namespace bromwich
