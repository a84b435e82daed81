#include "core/kernel/closed_loop.hpp"

#include "core/lcp/solution.hpp"
#include "core/numerics/components.hpp"
#include "core/numerics/sectorial.hpp"

#include <Eigen/Cholesky>

#include <cmath>
#include <vector>

namespace bromwich {

namespace {

// Whether the numerical range of A shows ||e^{At}|| <= harmless_growth on [0, T].
bool grows_harmlessly(const Matrix& A, double T) {
  Matrix shifted = -0.5 * (A + A.transpose());
  shifted.diagonal().array() += std::log(harmless_growth) / T;
  return Eigen::LLT<Matrix>(shifted).info() == Eigen::Success;
}

// Diagonal D such that D^{-1} A D has entries of equal size in each pair that couples two states; sum x_i^2 / D_i^2 is
// the energy of a network. Balancing leaves factors that grow along a chain.
Vector energy_scale(const Matrix& A) {
  Vector logarithms = Vector::Zero(A.rows());
  connected_components(
      A.rows(), [&](Index i, Index j) { return A(i, j) != 0 && A(j, i) != 0; },
      [&](Index i, Index j) {
        logarithms[j] = logarithms[i] + 0.5 * (std::log(std::abs(A(j, i))) - std::log(std::abs(A(i, j))));
      });
  return logarithms.array().exp();
}

// The same in the energy norm, if its scale is not too far from the units of A.
bool energy_grows_harmlessly(const Matrix& A, double T) {
  constexpr double most_apart = 1e6;
  const Vector D = energy_scale(A);
  return D.maxCoeff() <= most_apart * D.minCoeff() &&
         grows_harmlessly(D.cwiseInverse().asDiagonal() * A * D.asDiagonal(), T);
}

// Stops at the first row of y that is not valid.
StatesOfY closed_states(const DiscreteProblem& p, const StepOperators& step, const RowMatrix& y,
                        const StepDefects* defects) {
  const DenseDynamics& d = *p.small_state();
  const Index m = p.scene.states(), n = p.scene.constraints();
  const RowMatrix f = state_input(p, RowMatrix::Zero(p.J + 1, n)), g = p.g.table();
  RowMatrix forced = f * step.right.transpose();
  forced.bottomRows(p.J) += f.topRows(p.J) * step.left.transpose();
  if (defects) defects->add_to(forced);
  const Matrix left = step.left * d.B, right = step.right * d.B, implicit = to_dense(p.scene.M) + d.N * right;
  ActiveResponse response(implicit);
  StatesOfY states{RowMatrix::Constant(p.J + 1, m, NAN), 0};
  states.x.row(0) = p.scene.x0.transpose();
  Vector now = y.row(0).allFinite() ? Vector(y.row(0).transpose()) : Vector(Vector::Zero(n));
  Vector x(m), known(n), given(n);
  double largest = 0;
  for (Index j = 1; j <= p.J && y.row(j).allFinite(); ++j) {
    x.noalias() = step.decay * states.x.row(j - 1).transpose();
    x.noalias() += left * now;
    x += forced.row(j).transpose();
    now = y.row(j).transpose();
    known.noalias() = d.N * x + implicit * now;
    known += g.row(j).transpose();
    response.take(now);
    const Vector& delta = response.to(known);
    if (n > 0) states.correction = std::max(states.correction, delta.cwiseAbs().maxCoeff<Eigen::PropagateNaN>());
    if (n > 0) largest = std::max(largest, now.cwiseAbs().maxCoeff());
    now += delta;
    x.noalias() += right * now;
    states.x.row(j) = x.transpose();
  }
  states.correction = largest > 0 ? states.correction / largest : 0;
  return states;
}

}  // namespace

bool ActiveResponse::take(const Eigen::Ref<const Vector>& y) {
  std::vector<Index> S = support_of(y);
  if (S == support_) return false;
  support_.swap(S);
  if (!support_.empty()) lu_.compute(implicit_(support_, support_));
  return true;
}

const Vector& ActiveResponse::to(const Vector& v) {
  response_.setZero();
  if (!support_.empty()) response_(support_) = -Vector(lu_.solve(Vector(v(support_))));
  return response_;
}

Matrix ActiveResponse::to_columns(const Matrix& v) const {
  Matrix response = Matrix::Zero(implicit_.rows(), v.cols());
  if (!support_.empty()) response(support_, Eigen::all) = -Matrix(lu_.solve(Matrix(v(support_, Eigen::all))));
  return response;
}

double free_growth(const DiscreteProblem& p, const StepOperators& step) {
  if (p.scene.states() == 0) return 1;
  const Balanced b = balanced(p.small_state()->A);
  if (grows_harmlessly(b.A, p.scene.T) || energy_grows_harmlessly(b.A, p.scene.T)) return 1;
  Matrix power = b.D.cwiseInverse().asDiagonal() * step.decay * b.D.asDiagonal();
  double growth = 1;
  for (Index steps = 1;; steps *= 2) {
    const double norm = power.cwiseAbs().rowwise().sum().maxCoeff();
    if (!std::isfinite(norm)) return INFINITY;
    growth = std::max(growth, norm);
    // Powers of a norm below 1 do not grow; above harmless_growth the exact value does not matter.
    if (2 * steps > p.J || norm <= 1 || growth > harmless_growth) return growth;
    power = (power * power).eval();
  }
}

StatesOfY states_of(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const StepDefects* defects) {
  const std::shared_ptr<const StepOperators> step = state_step(p, rule);
  if (p.scene.constraints() == 0 || free_growth(p, *step) <= harmless_growth)
    return {states_from(p, rule, y, defects), 0};
  if (!defects && rule == Rule::exponential) defects = p.defects.get();
  return closed_states(p, *step, y, defects);
}

}  // namespace bromwich
