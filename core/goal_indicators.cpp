#include "core/goal_indicators.hpp"

#include <cmath>

namespace bromwich {
namespace {

Vector product(const StepMatrix& matrix, const Vector& x) {
  return std::visit([&](const auto& a) -> Vector { return a * x; }, matrix);
}

Vector transposed_product(const StepMatrix& matrix, const Vector& x) {
  return std::visit([&](const auto& a) -> Vector { return a.transpose() * x; }, matrix);
}

/// Row i+1: d_{i+1} + R x_i - S x_{i+1}; row 0 is 0.
RowMatrix residual(const StepChainProblem& problem, const RowMatrix& d, const RowMatrix& x) {
  RowMatrix r = d;
  r.row(0).setZero();
  for (Index i = 0; i < problem.steps(); ++i) {
    const StepMap& map = problem.maps[std::size_t(problem.map_of[std::size_t(i)])];
    const Vector left = x.row(i).transpose(), right = x.row(i + 1).transpose();
    r.row(i + 1) += (product(map.R, left) - product(map.S, right)).transpose();
  }
  return r;
}

/// S^{-T} q, all steps at once.
RowMatrix block_solve(Backend& backend, StepChain& chain, const RowMatrix& q) {
  return adjoint(backend, chain, q, {AdjointMethod::jacobi, 1});
}

/// The adjoint of the halved grid inside every cell: at its end it goes on with the coarse one.
RowMatrix local_weights(Backend& backend, StepChain& chain, const StepChainProblem& problem, const RowMatrix& gradient,
                        const RowMatrix& l) {
  const auto R_of = [&](Index step) -> const StepMatrix& {
    return problem.maps[std::size_t(problem.map_of[std::size_t(step)])].R;
  };
  const Index M = l.rows() - 1;
  RowMatrix q = gradient;
  for (Index i = 1; i < M; ++i)  // the cell from t_i on follows the second half of the one before
    q.row(2 * i) += transposed_product(R_of(2 * i), l.row(i + 1).transpose()).transpose();
  const RowMatrix second = block_solve(backend, chain, q);
  for (Index i = 0; i < M; ++i)
    q.row(2 * i + 1) += transposed_product(R_of(2 * i + 1), second.row(2 * i + 2).transpose()).transpose();
  return block_solve(backend, chain, q);  // its even rows are those of `second`
}

/// l taken as the value at the end of its cell, linear in between.
RowMatrix interpolated_weights(const RowMatrix& l) {
  const Index M = l.rows() - 1;
  RowMatrix z = RowMatrix::Zero(2 * M + 1, l.cols());
  for (Index i = 1; i <= M; ++i) {
    const Index before = std::max<Index>(i - 1, 1), behind = i > 1 ? i : std::min<Index>(2, M);
    const auto change = l.row(behind) - l.row(before);
    z.row(2 * i - 1) = l.row(before);
    z.row(2 * i) = l.row(before) + 0.5 * change;
  }
  return z;
}

}  // namespace

RowMatrix forward(Backend& backend, StepChain& chain, const RowMatrix& d) {
  const auto in = backend.array(d.rows(), d.cols()), out = backend.array(d.rows(), d.cols());
  backend.upload(d, *in);
  chain.forward(*in, *out);
  RowMatrix x(d.rows(), d.cols());
  backend.download(*out, x);
  return x;
}

RowMatrix adjoint(Backend& backend, StepChain& chain, const RowMatrix& q, const AdjointChoice& choice) {
  const auto in = backend.array(q.rows(), q.cols()), out = backend.array(q.rows(), q.cols());
  backend.upload(q, *in);
  chain.adjoint(*in, *out, choice);
  RowMatrix l(q.rows(), q.cols());
  backend.download(*out, l);
  return l;
}

Vector weighted_residual(Backend& backend, const StepChainProblem& fine, const RowMatrix& d, const RowMatrix& x,
                         const RowMatrix& gradient, CellWeights weights, const RowMatrix& l,
                         const AdjointChoice& choice) {
  const auto chain = backend.step_chain(fine);
  const RowMatrix r = residual(fine, d, x);
  const RowMatrix z = weights == CellWeights::global  ? adjoint(backend, *chain, gradient, choice)
                      : weights == CellWeights::local ? local_weights(backend, *chain, fine, gradient, l)
                                                      : interpolated_weights(l);
  Vector sums(fine.steps() / 2);
  for (Index i = 0; i < sums.size(); ++i)
    sums[i] = z.row(2 * i + 1).dot(r.row(2 * i + 1)) + z.row(2 * i + 2).dot(r.row(2 * i + 2));
  return sums;
}

double indicator_scale(StepScheme scheme, const QuantityOfInterest& quantity) {
  return -quantity.secant() / (1 - std::exp2(-order(scheme)));
}

Vector goal_indicators(const Trajectory& path, Backend& backend, const QuantityOfInterest& quantity,
                       CellWeights weights, const RowMatrix& l, const AdjointChoice& choice) {
  const PortSystem& system = path.system;
  const Vector t = halved(path.t);
  const RowMatrix x = prolonged(path);
  const RowMatrix gradient = quantity.gradient({system, path.scheme, t, x, 2 * path.per_cell});
  const StepChainProblem problem = system.step_problem(path.scheme, group_steps(t));
  const RowMatrix d = step_sources(system, path.scheme, t, path.x.row(0).transpose());
  return indicator_scale(path.scheme, quantity) *
         weighted_residual(backend, problem, d, x, gradient, weights, l, choice);
}

}  // namespace bromwich
