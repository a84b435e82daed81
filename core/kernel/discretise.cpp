#include "core/kernel/discretise.hpp"

#include "core/base/interruption.hpp"
#include "core/kernel/rough_response.hpp"
#include "core/kernel/start_rounding.hpp"
#include "core/numerics/step_propagator.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

// Contribution of f on rough steps beyond its linear interpolant between grid points.
std::shared_ptr<const StepDefects> defects_of_f(const DiscreteProblem& p) {
  const DenseDynamics& d = *p.small_state();
  Matrix F = source_matrix(p);
  if (p.f.shapes().size() > 0) F = (F * p.f.shapes()).eval();
  StepPropagator propagator(d.A, p.h);
  auto defects = std::make_shared<StepDefects>();
  defects->values.resize(Index(p.sources->rough.size()), F.rows());
  Polling poll;
  for (const RoughStep& rough : p.sources->rough) {
    const std::vector<Matrix> pieces = beyond_linear(p, rough);
    Matrix x = Matrix::Zero(F.rows(), 1);
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      poll();
      const Matrix e = F * pieces[i];
      propagator.advance(rough.pieces[i].length, {e.col(0), e.col(1), e.col(2)}, x);
    }
    defects->values.row(Index(defects->steps.size())) = x.transpose();
    defects->steps.push_back(rough.step);
  }
  return defects;
}

}  // namespace

DiscreteProblem discretise(const Scene& scene, Backend& backend, Index J, bool every_step, GridFamily* family) {
  GridFamily own;
  DiscreteProblem p = discretise_maps(scene, backend, J, family ? *family : own);
  p.t = time_grid(scene.T, J);
  sample_sources(p, every_step);
  return p;
}

DiscreteProblem discretise_points(const Scene& scene, Backend& backend, Index J) {
  GridFamily own;
  DiscreteProblem p = discretise_maps(scene, backend, J, own);
  p.t = time_grid(scene.T, J);
  sample_points(p);
  return p;
}

DiscreteProblem discretise_maps(const Scene& scene, Backend& backend, Index J, GridFamily& family) {
  DiscreteProblem p{scene, backend, family.lcp_class(scene), J, scene.T / double(J), {}, {}, {}, {}};
  p.shared = family.of(scene.dynamics);
  return p;
}

void sample_points(DiscreteProblem& p) {
  p.g = sample(p.scene.g, p.t, p.scene.constraints());
  p.f = p.scene.f ? sample(p.scene.f, p.t, p.scene.sources()) : SampledSource();
  set_start(p);
}

void sample_sources(DiscreteProblem& p, bool every_step) {
  sample_points(p);
  p.sources = {};
  p.defects = {};
  p.rough_response = {};
  resolve_sources(p, every_step);
}

namespace {

Vector rounding_of_start(const DiscreteProblem& p) {
  const double share = std::max(rounding_of_restarts, 4 * double(p.scene.states() + 1) * epsilon);
  const DenseDynamics* d = p.small_state();
  if (!d || d->E.size() > 0)
    return share * (p.scene.dynamics->observed_terms(p.scene.x0) + Vector(p.g.row(0).cwiseAbs()));
  const Vector f = p.f.size() > 0 ? Vector(source_matrix(p) * p.f.row(0)) : Vector(Vector::Zero(d->A.rows()));
  const Vector g = p.g.table().cwiseAbs().colwise().maxCoeff().transpose();
  return share * terms_of_motion(d->A, d->N, p.scene.x0, f, g, p.scene.T);
}

}  // namespace

void set_start(DiscreteProblem& p) {
  p.start = observe(p.scene.dynamics, p.scene.x0) + p.g.row(0);
  if (p.modes() || p.start.size() == 0 || !(p.start.minCoeff() < 0)) return;
  const Vector rounding = rounding_of_start(p);
  for (Index i = 0; i < p.start.size(); ++i)
    if (p.start[i] < 0 && p.start[i] >= -rounding[i]) p.start[i] = 0;
}

void resolve_sources(DiscreteProblem& p, bool every_step) {
  SourceSteps sources = find_source_steps(p.scene, p.t, p.f, p.g, every_step);
  if (sources.rough.empty()) return;
  p.sources = std::make_shared<SourceSteps>(std::move(sources));
  if (p.f.size() == 0) return;
  if (p.small_state())
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

DiscreteProblem coarser(const DiscreteProblem& p, Index steps) {
  const Index ratio = p.J / steps;
  DiscreteProblem coarse{p.scene, p.backend, p.lcp_class, steps, p.scene.T / double(steps), {}, {}, {}, p.start};
  coarse.shared = p.shared;
  coarse.t = p.t(Eigen::seqN(0, steps + 1, ratio));
  coarse.g = p.g.rows(0, steps + 1, ratio);
  if (p.f.size() > 0) coarse.f = p.f.rows(0, steps + 1, ratio);
  if (p.defects) resolve_sources(coarse, false);
  return coarse;
}

}  // namespace bromwich
