#include "core/kernel/modal_states.hpp"

#include "core/kernel/rough_response.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// x_{j+1} = decay x_j + left u_j + right u_{j+1} for every pair of modes, including b: K x n each, k across,
// l along.
struct ModalStep {
  RowMatrix decay, left, right;
};

ModalStep modal_step(const KroneckerDynamics& d, Rule rule, double h) {
  const Index n = d.face_points(), K = d.across.points;
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  const Matrix b = d.inputs_in_modes();
  ModalStep step{RowMatrix(K, n), RowMatrix(K, n), RowMatrix(K, n)};
  for (Index k = 0; k < K; ++k)
    for (Index l = 0; l < n; ++l) {
      const double x = h * (mu[l] + nu[k]);
      const bool exact = rule == Rule::exponential;
      const double p2 = exact ? phi2(x) : 0;
      step.decay(k, l) = exact ? std::exp(x) : 1 / (1 - x);
      const double hb = h * b(k, d.family(l));
      step.left(k, l) = exact ? hb * (phi1(x) - p2) : 0;
      step.right(k, l) = exact ? hb * p2 : hb / (1 - x);
    }
  return step;
}

}  // namespace

// Steps all modes of the state and records the requested grid points: their positions on the lines by a product with a
// few rows of their modes, the other direction by one transform for all time points.
RowMatrix modal_states(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const std::vector<Index>& components) {
  const KroneckerDynamics& d = *p.modes();
  const Index n = d.face_points(), K = d.across.points;
  const ModalStep step = modal_step(d, rule, p.h);
  const RowMatrix u =
      transformed(p.backend, p.face(), p.drive() ? RowMatrix(y + p.drive()->table()) : y, Way::to_modes);
  std::vector<Index> positions;
  for (const Index c : components) positions.push_back(c % K);
  std::sort(positions.begin(), positions.end());
  positions.erase(std::unique(positions.begin(), positions.end()), positions.end());
  const RowMatrix observe = d.across.modes()(positions, Eigen::all);

  RowMatrix x = x0_in_modes(p.backend, d, p.scene.x0, true).transpose();
  std::vector<RowMatrix> seen(positions.size(), RowMatrix(p.J + 1, n));  // per position, in modes of the lines
  RowMatrix now(Index(positions.size()), n);
  for (Index j = 0; j <= p.J; ++j) {
    if (j > 0) {
      x.array() = step.decay.array() * x.array();
      x.array() += step.left.array().rowwise() * u.row(j - 1).array();
      x.array() += step.right.array().rowwise() * u.row(j).array();
      if (p.rough_response && p.sources->at(j) && rule == Rule::exponential) x += modal_defect(p, *p.sources->at(j));
    }
    now.noalias() = observe * x;
    for (std::size_t i = 0; i < positions.size(); ++i) seen[i].row(j) = now.row(Index(i));
  }
  for (RowMatrix& line : seen) line = transformed(p.backend, p.face(), line, Way::to_points);

  RowMatrix states(p.J + 1, Index(components.size()));
  for (std::size_t c = 0; c < components.size(); ++c) {
    const auto at = std::lower_bound(positions.begin(), positions.end(), components[c] % K) - positions.begin();
    states.col(Index(c)) = seen[std::size_t(at)].col(components[c] / K);  // of two faces: the view from the first one
    states(0, Index(c)) = p.scene.x0[components[c]];
  }
  return states;
}

}  // namespace bromwich
