#include "core/host/step_chain.hpp"

#include "core/host/sparse_step_factors.hpp"
#include "core/numerics/equilibration.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <string>

namespace bromwich {

namespace {

bool is_step_square(const StepMatrix& matrix, Index m) {
  return std::visit([m](const auto& a) { return a.rows() == m && a.cols() == m; }, matrix);
}

bool is_step_finite(const StepMatrix& matrix) {
  if (const auto* dense = std::get_if<Matrix>(&matrix)) return dense->allFinite();
  const auto& sparse = std::get<SparseMatrix>(matrix);
  return Eigen::Map<const Vector>(sparse.valuePtr(), sparse.isCompressed() ? sparse.nonZeros() : 0).allFinite() &&
         std::isfinite(sparse.sum());
}

/// Whether `change` is R - S up to rounding.
bool is_difference(const StepMap& map) {
  const auto largest = [](const StepMatrix& matrix) -> double {
    if (const auto* dense = std::get_if<Matrix>(&matrix)) return dense->cwiseAbs().maxCoeff();
    double most = 0;
    const auto& sparse = std::get<SparseMatrix>(matrix);
    for (Index j = 0; j < sparse.outerSize(); ++j)
      for (SparseMatrix::InnerIterator entry(sparse, j); entry; ++entry) most = std::max(most, std::abs(entry.value()));
    return most;
  };
  const StepMap plain{map.S, map.R};
  const StepMatrix found = plain.difference();
  const StepMatrix apart = std::visit(
      [&](const auto& a) -> StepMatrix {
        using Kind = std::decay_t<decltype(a)>;
        return Kind(a - std::get<Kind>(map.change));
      },
      found);
  return largest(apart) <= 1e-8 * std::max(largest(map.S), largest(map.R));
}

StepMatrix identity_plus(double s, const StepMatrix& A) {
  const Index m = step_rows(A);
  if (const auto* dense = std::get_if<Matrix>(&A)) return Matrix(Matrix::Identity(m, m) + s * *dense);
  SparseMatrix I(m, m);
  I.setIdentity();
  SparseMatrix sum = I + s * std::get<SparseMatrix>(A);
  sum.makeCompressed();
  return sum;
}

StepMatrix times(double s, const StepMatrix& A) {
  return std::visit([s](const auto& a) -> StepMatrix { return std::decay_t<decltype(a)>(s * a); }, A);
}

/// `count` places sorted by key (stable).
std::vector<Index> sorted_by(const std::vector<Index>& places, const std::vector<Index>& keys, Index offset,
                             Index names) {
  std::vector<Index> start(std::size_t(names) + 1, 0), order(places.size());
  for (const Index i : places) ++start[std::size_t(keys[std::size_t(i + offset)]) + 1];
  std::partial_sum(start.begin(), start.end(), start.begin());
  for (const Index i : places) order[std::size_t(start[std::size_t(keys[std::size_t(i + offset)])]++)] = i;
  return order;
}

}  // namespace

Index StepChainProblem::states() const { return maps.empty() ? 0 : step_rows(maps.front().S); }

bool StepChainProblem::sparse() const { return !maps.empty() && std::holds_alternative<SparseMatrix>(maps.front().S); }

void StepChainProblem::validate() const {
  if (map_of.empty()) throw Error("steps", "found none", "give at least one step");
  if (maps.empty()) throw Error("maps", "found none", "give the matrices of the steps");
  const Index m = states();
  if (m == 0) throw Error("map 0", "found no states", "give square matrices");
  for (std::size_t k = 0; k < maps.size(); ++k) {
    const std::string name = "map " + std::to_string(k);
    const auto& [S, R, change] = maps[k];
    const bool changes = step_rows(change) > 0;
    if (!is_step_square(S, m) || !is_step_square(R, m) || (changes && !is_step_square(change, m)))
      throw Error(name, "found S or R that are not " + std::to_string(m) + " x " + std::to_string(m),
                  "give all maps the shape of the first");
    if (S.index() != maps.front().S.index() || R.index() != S.index() || (changes && change.index() != S.index()))
      throw Error(name, "found dense and sparse matrices", "give all of one kind");
    if (!is_step_finite(S) || !is_step_finite(R) || !is_step_finite(change))
      throw Error(name, "found a value that is not finite", "check the step size and the matrices");
    if (changes && !is_difference(maps[k]))
      throw Error(name, "found a change that is not R - S", "give R - S, or leave it out");
  }
  for (std::size_t i = 0; i < map_of.size(); ++i)
    if (map_of[i] < 0 || map_of[i] >= Index(maps.size()))
      throw Error("step " + std::to_string(i + 1), "found map " + std::to_string(map_of[i]),
                  "use one of the " + std::to_string(maps.size()) + " maps");
}

Index AdjointChoice::checked_sweeps() const {
  if (sweeps < 1) throw Error("sweeps", "found " + std::to_string(sweeps), "do at least one");
  return sweeps;
}

DenseStep::DenseStep(const StepChainProblem& problem, Index map) {
  const StepMap& given = problem.maps[std::size_t(map)];
  if (problem.sparse()) {
    SparseStepFactors step(given);
    if (step.singular) throw singular_step(problem, map);
    R = step.R;
    change = step.change;
    increment = step.lu.solve(Matrix(change));
    inverse = step.lu.solve(Matrix(Matrix::Identity(R.rows(), R.rows())));
    return;
  }
  R = std::get<Matrix>(given.R);
  change = std::get<Matrix>(given.difference());
  const Eigen::PartialPivLU<Matrix> lu(std::get<Matrix>(given.S));
  if (!(reciprocal_condition(lu) >= epsilon)) throw singular_step(problem, map);
  increment = lu.solve(change);
  inverse = lu.inverse();
}

Error singular_step(const StepChainProblem& problem, Index map) {
  const auto at = std::find(problem.map_of.begin(), problem.map_of.end(), map);
  return {"map " + std::to_string(map),
          at == problem.map_of.end()
              ? std::string("found a singular matrix S")
              : "found a singular matrix S, of step " + std::to_string(at - problem.map_of.begin() + 1),
          "take another step size"};
}

void check_products(double bytes, double limit, const char* method) {
  if (bytes <= limit) return;
  const auto megabytes = [](double b) { return std::to_string(std::llround(b / 1e6)) + " MB"; };
  throw Error("adjoint",
              std::string(method) + " would take " + megabytes(bytes) + " for products of steps where " +
                  megabytes(limit) + " are allowed",
              "use substitution or jacobi, or allow more");
}

StepSizes group_steps(const Vector& t) {
  const Index M = t.size() - 1;
  if (M < 1) throw Error("t", "found " + std::to_string(t.size()) + " points", "give two at least");
  if (!t.allFinite()) throw Error("t", "found a time that is not finite", "give finite times");
  std::vector<double> h(static_cast<std::size_t>(M));
  for (Index i = 0; i < M; ++i) {
    h[std::size_t(i)] = t[i + 1] - t[i];
    if (!(h[std::size_t(i)] > 0))
      throw Error("t", "found t[" + std::to_string(i + 1) + "] <= t[" + std::to_string(i) + "]", "let times increase");
  }
  std::vector<double> sorted;
  std::unique_copy(h.begin(), h.end(), std::back_inserter(sorted));
  std::sort(sorted.begin(), sorted.end());
  // Each time has a rounding error of eps/2 |t|, and halving a step adds as much again.
  const double rounding = 4 * epsilon * t.cwiseAbs().maxCoeff();
  std::vector<double> sizes;
  for (const double size : sorted)
    if (sizes.empty() || size - sizes.back() > rounding) sizes.push_back(size);
  StepSizes groups;
  groups.of.resize(h.size());
  for (std::size_t i = 0; i < h.size(); ++i)
    groups.of[i] = std::upper_bound(sizes.begin(), sizes.end(), h[i]) - sizes.begin() - 1;
  groups.sizes = Eigen::Map<const Vector>(sizes.data(), Index(sizes.size()));
  return groups;
}

StepMap step_map(StepScheme scheme, const StepMatrix& A, double h) {
  switch (scheme) {
    case StepScheme::euler:
      return {identity_plus(-h, A), identity_plus(0, A), times(h, A)};
    case StepScheme::midpoint:
      return {identity_plus(-h / 2, A), identity_plus(h / 2, A), times(h, A)};
    case StepScheme::exponential:
      break;
  }
  const auto* dense = std::get_if<Matrix>(&A);
  if (!dense) throw Error("scheme", "found exponential steps with a sparse matrix", "use euler or midpoint");
  const Matrix X = h * *dense;
  const MatrixPhi phi = matrix_phi(X);
  StepMap map{identity_plus(0, A), phi.exponential};
  // e^X - I = X phi_1(X). For large X this product has more rounding error than the subtraction.
  if (X.cwiseAbs().rowwise().sum().maxCoeff() <= 1) map.change = Matrix(X * phi.phi1);
  return map;
}

StepChainProblem step_chain_problem(StepScheme scheme, const StepMatrix& A, const StepSizes& steps) {
  StepChainProblem problem;
  problem.map_of = steps.of;
  problem.maps.reserve(std::size_t(steps.sizes.size()));
  for (const double h : steps.sizes) problem.maps.push_back(step_map(scheme, A, h));
  return problem;
}

WindowNames join_windows(const std::vector<Index>& of, Index names, Index length) {
  WindowNames windows;
  const Index count = std::max<Index>(0, Index(of.size()) - length);
  std::vector<Index> order(static_cast<std::size_t>(count));
  std::iota(order.begin(), order.end(), Index(0));
  order = sorted_by(sorted_by(order, of, length, names), of, 0, names);
  windows.of.resize(order.size());
  for (const Index i : order) {
    const std::pair<Index, Index> halves{of[std::size_t(i)], of[std::size_t(i + length)]};
    if (windows.halves.empty() || windows.halves.back() != halves) windows.halves.push_back(halves);
    windows.of[std::size_t(i)] = Index(windows.halves.size()) - 1;
  }
  return windows;
}

}  // namespace bromwich
