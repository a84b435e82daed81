#include "core/discrete_problem.hpp"

#include "core/error.hpp"
#include "core/kernel.hpp"
#include "core/lcp.hpp"

#include <map>

namespace bromwich {

namespace {

Vector seen(const Dynamics& dynamics, const Vector& x0) {
  if (const auto* d = std::get_if<DenseDynamics>(&dynamics)) return d->N * x0;
  const auto& d = std::get<KroneckerDynamics>(dynamics);
  return Eigen::Map<const RowMatrix>(x0.data(), d.along.points, d.across.points) * d.n;
}

// One grid line is one observer: the recurrence with n replaced by a unit vector, run over y + phi.
RowMatrix line_states(const DiscreteProblem& p, const ModalRecurrence& r, const RowMatrix& input) {
  const Index rows = p.J + 1, n = input.cols();
  const auto y = p.backend.array(rows, n), modes = p.backend.array(rows, n), x = p.backend.array(rows, n);
  const auto sine = p.backend.sine_transform(n, rows);
  p.backend.upload(input, *y);
  sine->apply(*y, nullptr, *modes, 0);
  p.backend.convolution(Recurrence(r), rows)->apply(*modes, *x, 0);
  sine->apply(*x, nullptr, *modes, 0);
  RowMatrix states;
  p.backend.download(*modes, states);
  return states;
}

RowMatrix kronecker_states(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const std::vector<Index>& components) {
  KroneckerDynamics observed = *p.kronecker();
  const Index K = observed.across.points;
  const RowMatrix x0 = x0_in_modes(p.backend, observed, p.scene.x0, true);
  const RowMatrix input = p.drive() ? RowMatrix(y + *p.drive()) : y;
  std::map<Index, std::vector<std::size_t>> columns_at;  // position on the line -> columns of the result
  for (std::size_t c = 0; c < components.size(); ++c) columns_at[components[c] % K].push_back(c);
  RowMatrix x(p.J + 1, Index(components.size()));
  for (const auto& [position, columns] : columns_at) {
    observed.n = Vector::Unit(K, position);
    const RowMatrix states = line_states(p, modal_recurrence(observed, rule, p.h, x0), input);
    for (const std::size_t c : columns) {
      x.col(Index(c)) = states.col(components[c] / K);
      x(0, Index(c)) = p.scene.x0[components[c]];
    }
  }
  return x;
}

}  // namespace

DiscreteProblem discretise(const Scene& scene, Backend& backend, Index J) {
  const LcpClass lcp_class = scene.lcp_class == LcpClass::automatic ? classify(scene.M) : scene.lcp_class;
  DiscreteProblem p{scene, backend, lcp_class, J, scene.T / double(J), time_grid(scene.T, J), {}, {}, {}};
  p.g = sample(scene.g, p.t, scene.constraints());
  const Index width = scene.f_entry == SourceEntry::through_B ? scene.constraints() : scene.states();
  if (scene.f) p.f = sample(scene.f, p.t, width);
  p.start = seen(scene.dynamics, scene.x0) + p.g.row(0).transpose();
  return p;
}

RowMatrix state_input(const DiscreteProblem& p, const RowMatrix& y) {
  const Matrix& B = p.dense()->B;
  if (const RowMatrix* phi = p.drive()) return (y + *phi) * B.transpose();
  RowMatrix input = y * B.transpose();
  if (p.f.size() > 0) input += p.f;
  return input;
}

RowMatrix dense_response(const DiscreteProblem& p, Rule rule) {
  const RowMatrix input = state_input(p, RowMatrix::Zero(p.J + 1, p.scene.constraints()));
  return p.g + dense_states(p.dense()->A, rule, p.h, p.scene.x0, input) * p.dense()->N.transpose();
}

RowMatrix kronecker_initial_response(const DiscreteProblem& p) {
  const KroneckerDynamics& d = *p.kronecker();
  return contour_initial_response(d, *contour_parameters(0), x0_in_modes(p.backend, d, p.scene.x0, false), p.h, p.J);
}

RowMatrix reconstruct_states(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const std::vector<Index>& components) {
  if (components.empty()) return RowMatrix(p.J + 1, 0);
  const double bytes = 8.0 * double(p.J + 1) * double(components.size());
  if (bytes > 16e9)
    throw Error("states", "the table would take " + std::to_string(long(bytes / 1e9)) + " GB", "ask for fewer components or steps");
  if (p.kronecker()) return kronecker_states(p, rule, y, components);
  const RowMatrix all = dense_states(p.dense()->A, rule, p.h, p.scene.x0, state_input(p, y));
  RowMatrix x(p.J + 1, Index(components.size()));
  for (std::size_t c = 0; c < components.size(); ++c) x.col(Index(c)) = all.col(components[c]);
  return x;
}

}  // namespace bromwich
