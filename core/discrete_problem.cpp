#include "core/discrete_problem.hpp"

#include "core/kernel.hpp"
#include "core/lcp/active_set_lcp.hpp"
#include "core/rough_response.hpp"
#include "core/step_propagator.hpp"

#include <algorithm>

namespace bromwich {

namespace {

// What f does on rough steps beyond its linear function between points of the grid.
std::shared_ptr<const StepDefects> defects_of_f(const DiscreteProblem& p) {
  const DenseDynamics& d = *p.dense();
  Matrix F = source_matrix(p);
  if (p.f.shapes().size() > 0) F = (F * p.f.shapes()).eval();
  StepPropagator propagator(d.A, p.h);
  auto defects = std::make_shared<StepDefects>();
  defects->values.resize(Index(p.sources->rough.size()), F.rows());
  for (const RoughStep& rough : p.sources->rough) {
    const Index j = rough.step;
    const Vector before = p.f.values().row(j - 1).transpose(), slope = p.f.values().row(j).transpose() - before;
    Matrix e = Matrix::Zero(F.rows(), 1);
    for (const SourcePiece& piece : rough.pieces) {
      const double from = (piece.start - p.t[j - 1]) / p.h, length = piece.length / p.h;
      Matrix apart = piece.phi;
      apart.col(0) -= before + from * slope;
      apart.col(1) -= length * slope;
      apart = (F * apart).eval();
      propagator.advance(piece.length, {apart.col(0), apart.col(1), apart.col(2)}, e);
    }
    defects->values.row(Index(defects->steps.size())) = e.transpose();
    defects->steps.push_back(j);
  }
  return defects;
}

}  // namespace

void StepDefects::add_to(RowMatrix& x) const {
  for (std::size_t i = 0; i < steps.size(); ++i) x.row(steps[i]) += values.row(Index(i));
}

DiscreteProblem discretise(const Scene& scene, Backend& backend, Index J, bool every_step) {
  const LcpClass lcp_class = scene.lcp_class == LcpClass::automatic ? classify(scene.M) : scene.lcp_class;
  DiscreteProblem p{scene, backend, lcp_class, J, scene.T / double(J), time_grid(scene.T, J), {}, {}, {}};
  p.g = sample(scene.g, p.t, scene.constraints());
  if (scene.f) p.f = sample(scene.f, p.t, scene.sources());
  p.start = observe(scene.dynamics, scene.x0) + p.g.row(0);
  resolve_sources(p, every_step);
  return p;
}

void resolve_sources(DiscreteProblem& p, bool every_step) {
  SourceSteps sources = find_source_steps(p.scene, p.t, p.f, p.g, every_step);
  if (sources.rough.empty()) return;
  p.sources = std::make_shared<SourceSteps>(std::move(sources));
  if (p.f.size() == 0) return;
  if (p.dense())
    p.defects = defects_of_f(p);
  else
    p.rough_response = rough_response(p);
}

DiscreteProblem with_mean_sources(const DiscreteProblem& p) {
  DiscreteProblem mean = p;
  mean.defects = {};
  mean.rough_response = {};
  for (const RoughStep& rough : p.sources->rough) {
    if (rough.pieces.empty()) continue;
    Vector sum = Vector::Zero(rough.pieces[0].phi.rows());
    for (const SourcePiece& piece : rough.pieces)
      sum += piece.length * piece.phi * Eigen::Vector3d(1, 1.0 / 2, 1.0 / 3);
    mean.f.replace(rough.step, sum / p.h);
  }
  return mean;
}

void add_rough_response(const DiscreteProblem& p, Array& r) {
  if (!p.rough_response) return;
  const auto more = p.backend.array(p.rough_response->rows(), p.rough_response->cols());
  p.backend.upload(*p.rough_response, *more);
  p.backend.add(r, 1, *more, r);
}

std::size_t host_bytes(const DiscreteProblem& p) {
  return sizeof(double) * std::size_t(p.g.size()) + p.g.bytes() + p.f.bytes();
}

std::shared_ptr<const StepOperators> state_step(const DiscreteProblem& p, Rule rule) {
  if (rule != Rule::exponential) return std::make_shared<StepOperators>(step_operators(p.dense()->A, rule, p.h));
  return p.exponential_step->get(
      [&] { return std::make_shared<StepOperators>(step_operators(p.dense()->A, rule, p.h, p.J)); });
}

Matrix source_matrix(const DiscreteProblem& p) {
  if (p.scene.f_entry == SourceEntry::through_F) return p.scene.F;
  if (p.scene.f_entry == SourceEntry::through_B) return p.dense()->B;
  return Matrix::Identity(p.scene.states(), p.scene.states());
}

RowMatrix state_input(const DiscreteProblem& p, const RowMatrix& y) {
  const Matrix& B = p.dense()->B;
  if (const SampledSource* phi = p.drive()) return (y + phi->table()) * B.transpose();
  RowMatrix input = y * B.transpose();
  if (p.f.size() > 0 && p.scene.f_entry == SourceEntry::through_F)
    input += p.f.table() * p.scene.F.transpose();
  else if (p.f.size() > 0)
    input += p.f.table();
  return input;
}

RowMatrix states_from(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const StepDefects* defects) {
  if (!defects && rule == Rule::exponential) defects = p.defects.get();
  return dense_states(*state_step(p, rule), p.scene.x0, state_input(p, y), defects);
}

RowMatrix dense_response(const DiscreteProblem& p, Rule rule) {
  const RowMatrix none = RowMatrix::Zero(p.J + 1, p.scene.constraints());
  return p.g.table() + states_from(p, rule, none) * p.dense()->N.transpose();
}

RowMatrix trace(const DiscreteProblem& p, const Array& r, const Array& v) {
  RowMatrix known, response;
  p.backend.download(r, known);
  p.backend.download(v, response);
  return known + response - p.g.table();
}

std::optional<InitialSum> kronecker_initial_sum(const DiscreteProblem& p, const ExponentialSum& sum) {
  const KroneckerDynamics& d = *p.kronecker();
  InitialSum x0 = compress_initial_response(p.backend, d, sum, p.scene.x0, p.h, p.scene.T);
  if (!(x0.error <= accepted_compression_error)) return std::nullopt;
  return x0;
}

RowMatrix kronecker_initial_response(const DiscreteProblem& p) {
  const KroneckerDynamics& d = *p.kronecker();
  return contour_initial_response(d, *contour_parameters(0), x0_in_modes(p.backend, d, p.scene.x0, false), p.h, p.J);
}

}  // namespace bromwich
