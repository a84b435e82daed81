// Iterates of the functional iteration one by one, and the constants of the bound on them.
//
// symbol  variable    meaning
// k       k           sweeps: y^k in SOL(M, N x^{k-1} + g), x^k from y^k, x^0(t) = x0
// φ       phi         ||(zI-A)^{-1}|| <= φ/|z|                                                             (2.1b)
// Θ_l     theta       l ∫_0^1 (1-τ)^{l-1} Σ_p |z'_p/z_p| e^{τ Re z_p} dτ at t = 1, here with dv/(2 pi)     (2.7b)

#include "bench/studies/paper.hpp"
#include "core/base/error.hpp"
#include "core/numerics/contour.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>

namespace bromwich::app {

double largest_difference(const RowMatrix& a, const RowMatrix& b) {
  if (a.size() == 0 || a.rows() != b.rows() || a.cols() != b.cols()) return NAN;
  return (a - b).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
}

Iterates::Iterates(const Scene& scene, Backend& backend, Index steps, bool with_states)
    : scene_(scene), backend_(backend), steps_(steps), with_states_(with_states) {
  // Below rounding: the iteration continues until nothing changes.
  Options to_the_end = options(Options{}.max_iterations);
  converged_ = solve(scene, backend, to_the_end);
  if (converged_.status != Status::solved)
    throw bromwich::Error("SCENE",
                          fmt::format("contour on {} with {} steps ended as {} ({})", scene.name, steps,
                                      to_string(converged_.status), converged_.reason),
                          "the study compares iterates with the converged one");
}

Options Iterates::options(Index k) const {
  Options o;
  o.method = Method::contour;
  o.steps = steps_;
  o.iteration_tolerance = 1e-15;
  o.max_iterations = k;
  o.trace = true;
  if (with_states_) o.states = StateSelection::all;
  return o;
}

const Iterates::Error& Iterates::error(Index k) {
  const auto known = errors_.find(k);
  if (known != errors_.end()) return known->second;
  const Result r = solve(scene_, backend_, options(k));
  return errors_[k] = {largest_difference(r.y, converged_.y), largest_difference(r.trace, converged_.trace),
                       with_states_ ? largest_difference(r.x, converged_.x) : NAN};
}

double Iterates::start_error() const {
  if (!with_states_) return NAN;
  return (converged_.x.rowwise() - scene_.x0.transpose()).rowwise().norm().maxCoeff();
}

Index Iterates::sweeps_to(double tolerance, const std::function<double(const Error&)>& of) {
  Index above = 0, below = converged_.iterations;
  while (below - above > 1) {
    const Index middle = (above + below) / 2;
    (of(error(middle)) <= tolerance ? below : above) = middle;
  }
  return below;
}

namespace {

constexpr Index most_sweeps = 100000;  ///< the bound is not computed beyond

/// l ∫_0^1 (1-τ)^{l-1} e^{a τ} dτ by Simpson's rule on the part that is not negligible.
double theta(Index l, double a) {
  constexpr int panels = 100;
  const double end = std::min(1.0, 40 / std::max(1.0, double(l - 1) - std::min(a, 0.0))), width = end / panels;
  const auto f = [&](double tau) { return double(l) * std::pow(1 - tau, double(l - 1)) * std::exp(a * tau); };
  double sum = f(0) + f(end);
  for (int i = 0; i < panels; ++i) sum += 4 * f((i + 0.5) * width) + (i > 0 ? 2 * f(i * width) : 0);
  return sum * width / 6;
}

double norm2(const Matrix& a) { return Eigen::JacobiSVD<Matrix>(a).singularValues()[0]; }

/// L of Lemma 3.1; singular M_SS do not count.
double lipschitz_constant(const Matrix& M) {
  constexpr double singular = 1e-12;
  double largest = 0;
  for (Index set = 1; set < (Index(1) << M.rows()); ++set) {
    std::vector<Index> S;
    for (Index i = 0; i < M.rows(); ++i)
      if (set >> i & 1) S.push_back(i);
    const Vector values = Eigen::JacobiSVD<Matrix>(Matrix(M(S, S))).singularValues();
    const double smallest = values[values.size() - 1];
    if (smallest > singular * values[0]) largest = std::max(largest, 1 / smallest);
  }
  return largest;
}

/// sup |z| ||(zI-A)^{-1}|| over the nodes of the contours of all time points, where the proof needs it.
double resolvent_constant(const Matrix& A, Index P, double T, Index steps) {
  double largest = 0;
  for (Index j = 1; j <= steps; ++j)
    for (const Complex& z : literal_contour(P, T * double(j) / double(steps)).nodes) {
      const ComplexMatrix shifted = z * ComplexMatrix::Identity(A.rows(), A.rows()) - A.cast<Complex>();
      const Vector values = Eigen::JacobiSVD<ComplexMatrix>(shifted).singularValues();
      largest = std::max(largest, std::abs(z) / values[values.size() - 1]);
    }
  return largest;
}

/// dv/(2 pi) Θ_k: a weight is dv/(2 pi) |z'|, doubled for the conjugate node.
double contour_sum(const Contour& unit, Index k) {
  double sum = 0;
  for (Index p = 0; p < unit.nodes.size(); ++p)
    sum += std::abs(unit.weights[p] / unit.nodes[p]) * theta(k, unit.nodes[p].real());
  return sum;
}

}  // namespace

IterationBound iteration_bound(const Scene& scene, Index nodes, Index steps, Index least) {
  const DenseDynamics d = to_dense(scene.dynamics);
  IterationBound bound{resolvent_constant(d.A, nodes, scene.T, steps), lipschitz_constant(to_dense(scene.M)), 0, {0}};
  bound.factor = bound.phi * bound.lipschitz * norm2(d.B) * norm2(d.N) * scene.T;
  double sum = 0;
  for (Index k = 1, next = 1; k <= least || (bound.decades.back() >= 0 && k <= most_sweeps); ++k) {
    if (k == next) {  // smooth in k: computed again when k has grown by a percent
      sum = contour_sum(literal_contour(nodes, 1), k);
      next = k + 1 + k / 100;
    }
    bound.decades.push_back(bound.decades.back() + std::log10(bound.factor * sum / double(k)));
  }
  return bound;
}

Index IterationBound::useful_from() const {
  const auto below = std::find_if(decades.begin() + 1, decades.end(), [](double value) { return value < 0; });
  return below == decades.end() ? -1 : Index(below - decades.begin());
}

}  // namespace bromwich::app
