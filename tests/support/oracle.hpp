#pragma once
// An independent dense oracle for small scenes. It shares with core only the types of a scene. Matrix functions come
// from Eigen's exponential (scaling and squaring), complementarity problems are solved by enumeration of active sets.
//
// symbol   here               meaning
// e^{hA}   Phi::exponential   phi1(z) = (e^z - 1)/z, phi2(z) = (e^z - 1 - z)/z^2, all at z = hA
// W_d,S_d  Weights            lag weights of continuous piecewise-linear y
// L        lipschitz          max over active sets S of ||M_SS^{-1}||_inf

#include "core/scene/scene.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace bromwich::oracle {

/// The scene with dense matrices; f is always an m-vector.
struct DenseScene {
  Matrix A, B, N, M;
  LcpClass lcp_class = LcpClass::P;
  TimeFunction f, g;  ///< never empty
  Vector x0;
  double T = 1;
};

DenseScene write_out(const Scene&);

struct Phi {
  Matrix exponential, phi1, phi2;
};

/// The exponential, phi1 and phi2 at X, from one exponential of an augmented matrix.
Phi phi_functions(const Matrix& X);

/// e^X.
Matrix exponential(const Matrix& X);

/// Weights of the discrete convolution: v_j = Σ_{d<j} W_d y_{j-d} + S_j y_0.
struct Weights {
  std::vector<Matrix> W, S;  ///< lags 0..J; S[0] is zero
};

Weights weights(const DenseScene&, double h, Index J);

/// The same by Gauss-Legendre quadrature (16 points per interval) of ∫ K(t_d - s) hat(s) ds, K(t) = N e^{At} B.
Weights quadrature_weights(const DenseScene&, double h, Index J);

/// Solution of LCP(M, q) by enumeration, n <= 10: the one with the smallest residual (P), or the componentwise minimum
/// of all solutions (Z). Empty if there is none.
std::optional<Vector> solve_lcp(const Matrix& M, const Vector& q, LcpClass);

/// max_S ||M_SS^{-1}||_inf; infinite where some M_SS is singular.
double lipschitz(const Matrix& M);

/// P (by minors), else PSD, else Z with a positive diagonal, else unknown; by definition, n <= 10.
LcpClass class_of(const Matrix& M);

/// The function's values at t.
Vector value(const TimeFunction&, double t, Index size);

/// The indices i < n whose bits are set.
std::vector<Index> members(unsigned set, Index n);

/// By determinants, for entries of size about 1 and n <= 12.
double smallest_principal_minor(const Matrix& M);

/// All principal minors are clearly positive; n <= 12.
bool is_p_matrix(const Matrix& M);

/// One solution for each active set that has one, in any units, n <= 6. If M_SS is singular, the least-norm one on S.
std::vector<Vector> solutions(const Matrix& M, const Vector& q);

/// The solution that the class selects: least (Z), least-norm (PSD), any. Empty if there is none.
std::optional<Vector> selected_solution(const Matrix& M, const Vector& q, LcpClass);

/// Some solution, n <= 12; tries active sets close to that of `near` first. Empty if no active set with nonsingular
/// M_SS gives one.
std::optional<Vector> some_solution(const Matrix& M, const Vector& q, const Vector& near);

struct Trajectory {
  Vector t;
  RowMatrix y, x;
  Index infeasible = -1;  ///< first row without a solution; rows from there on are NaN
};

/// The three discretisations.
enum class Scheme {
  exponential,  ///< y and f piecewise linear
  euler,        ///< implicit Euler
  radau,        ///< Radau IIA with two stages on the state, Y = (y at c = 1/3, y at c = 1)
};

/// One step: 0 <= Y ⊥ matrix Y + q >= 0 for y at all stages, x_j = free + drive Y.
struct StepProblem {
  Matrix matrix, drive;
  Vector q, free;
};

/// The steps of a scheme by dense linear algebra with the full stage system.
class Steps {
 public:
  Steps(const DenseScene&, Scheme, Index J);
  StepProblem problem(Index j, const Vector& x, const Vector& y) const;  ///< the step to t_j from x_{j-1}, y_{j-1}

 private:
  const DenseScene& s_;
  Scheme scheme_;
  double h_;
  Matrix decay_, left_, right_;  ///< of the stages: X = decay x + left u_{j-1} + right (u of the stages), u = B y + f
};

/// Some Y that solves a step. For Z with one stage it must also be the least element of LCP(M, N x_j + g_j).
std::optional<Vector> step_solution(const DenseScene&, const StepProblem&, const Vector& near);

/// Whether a Radau IIA step must be replaced by implicit Euler because the state jumps: some y_i is active at the first
/// stage and not at the second, and either these y move a component by more than a quarter of its size (or of a
/// hundredth of the largest), h |B y|, or one has more than four times `regular`, its largest value at the ends of
/// steps without jumps. `margin` above 1: clearly; below 1: nearly.
bool jumps(const DenseScene&, double h, const Vector& Y, const Vector& before, const Vector& after,
           const Vector& regular, double margin = 1);

/// The whole march in any units. Starts with y_0, or without it if M is singular and there is none (an impulse; not for
/// exponential). Every step takes some solution (Z with one stage: the least). Radau IIA uses Euler for jumps.
Trajectory trajectory(const DenseScene&, Scheme, Index J);

/// Exponential marching, y and f piecewise linear.
Trajectory march(const DenseScene&, Index J);
/// Implicit Euler.
Trajectory euler(const DenseScene&, Index J);

/// The state for piecewise-linear y and f, (J+1) x m.
RowMatrix states_of(const DenseScene&, const RowMatrix& y);

/// max_j ||min(y, N x + M y + g)||_inf / max(1, ||N x + g||_inf) for given y and x; NaN if they contain a NaN.
double complementarity_residual(const DenseScene&, const RowMatrix& y, const RowMatrix& x);

enum class SpectrumKind { real_negative, sector, imaginary };
enum class MatrixKind { dominant, positive_definite, m_matrix };

/// A random scene with m states and n constraints, sine sources, T = 1. `dominant` and `positive_definite` are P
/// (random signs off the diagonal; L L^T + I/2 plus a small skew part); `m_matrix` is declared as class Z.
Scene random_scene(std::uint32_t seed, Index m, Index n, SpectrumKind, MatrixKind);

}  // namespace bromwich::oracle
