#pragma once
// Port-Hamiltonian scenes with complementarity on any time grid, M of class P:
//
//     x' = A x + B y + f,   0 <= y ⊥ N x + M y + g >= 0.
//
// A step evaluates y at one point e of its reconstruction, the right end (Euler) or the middle (midpoint):
//
//     b = a + h (A e + B y + f(t_e)),   y in SOL(M, N e + g(t_e)).
//
// Where y_S > 0 the dynamics are linear, with y = -K (N e + g), K = M_SS^{-1} in the rows and columns of S:
//
//     x' = A_S x + f - B K g,   A_S = A - B K N,
//
// so that along a solution every step is a linear one-step map that depends on h and S, and the adjoint of the solution
// is that of a chain (core/host/step_chain.hpp): exact wherever no y_i + w_i vanishes.

#include "reconstruction.hpp"

#include <map>

namespace bromwich {

class Backend;

/// The dynamics while the constraints of one set are active.
struct ActiveMode {
  StepMatrix A;  ///< A_S
  Matrix K;      ///< n x n
  Matrix slope;  ///< n x m, -K N: how y follows e
};

class ConstrainedSystem {
 public:
  /// Throws Error if the scene has no port, has free rows, or M is not of class P.
  explicit ConstrainedSystem(const Scene&);

  const Scene& scene() const { return scene_; }
  const PortSystem& port() const { return port_; }
  Index constraints() const { return N_.rows(); }
  const SparseMatrix& B() const { return B_; }
  const SparseMatrix& N() const { return N_; }
  const Matrix& M() const { return M_; }
  const RowMatrix& port_matrix() const { return port_matrix_; }  ///< Q^T E B: y supplies y^T B^T Q^T E x
  Vector g(double t) const;
  /// Bytes that products of steps may take.
  void limit_memory(double bytes) { port_.memory_limit = bytes; }

  /// The mode with the set {y > 0}, made on first use.
  Index mode_of(const Eigen::Ref<const Vector>& y);
  const ActiveMode& mode(Index k) const { return modes_[std::size_t(k)]; }
  Index modes() const { return Index(modes_.size()); }

 private:
  const Scene& scene_;
  PortSystem port_;
  SparseMatrix B_, N_;
  Matrix M_;
  RowMatrix port_matrix_;
  std::map<std::vector<Index>, Index> numbers_;  ///< of the modes, by S
  std::vector<ActiveMode> modes_;
};

/// y at one point of every step and the modes they belong to.
struct ConstraintValues {
  RowMatrix y;               ///< M x n
  std::vector<Index> modes;  ///< M
};

/// y within the steps of a trajectory, y(t) in SOL(M, N x(t) + g(t)), at the nodes of its quadrature, for the integrals
/// of the energy balance. Euler: the y of the step. Midpoint: differs from the y of the step if a constraint switches
/// within it, which contributes to the violation of the balance.
struct ConstraintPath {
  const ConstrainedSystem* system = nullptr;
  std::vector<ConstraintValues> nodes;  ///< by node of quadrature(scheme)
};

/// The point of a step at which complementarity holds, as a fraction of the step: 1 or 1/2. Throws Error for the
/// exponential scheme.
double constraint_point(StepScheme);

struct ConstrainedSolution {
  RowMatrix x;              ///< (M+1) x m
  ConstraintValues steps;   ///< y of the steps
  Index unsolved = -1;      ///< first step whose problem was not solved, or -1
  bool infeasible = false;  ///< proven there
  bool nonfinite = false;   ///< the data of its problem are not finite
};
/// Solves step by step. Rows from an unsolved step on are NaN.
ConstrainedSolution solve_constrained(ConstrainedSystem&, StepScheme, const Vector& t, const Vector& x0);

/// y in SOL(M, N e + g) at the given points, rows of e, all at once. Throws Error if a problem stays unsolved.
ConstraintValues constraints_at(ConstrainedSystem&, Backend&, const Vector& times, const RowMatrix& e);
/// The same at fraction s of all steps of a trajectory, and at the nodes of its quadrature.
ConstraintValues constraints_within(ConstrainedSystem&, Backend&, const Trajectory&, double s);
ConstraintPath constraints_along(ConstrainedSystem&, Backend&, const Trajectory&);

/// The chain of steps for given y, and its sources d. A solution satisfies S x_i = R x_{i-1} + d_i; for another x with
/// its y, the difference is the residual of the nonlinear step.
struct ConstrainedChain {
  StepChainProblem problem;
  RowMatrix d;
};
ConstrainedChain constrained_chain(const ConstrainedSystem&, StepScheme, const Vector& t, const Vector& x0,
                                   const ConstraintValues&);

/// ∫ y^T B^T Q^T E x over each step: M.
Vector constraint_supply(const Trajectory&);
/// Adds the derivative of Σ weights_i (constraint_supply)_i, with y a function of x, to `gradient`.
void add_constraint_supply(const Trajectory&, const Vector& weights, RowMatrix& gradient);

}  // namespace bromwich
