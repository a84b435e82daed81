#include "batch/lane_march.hpp"

#include "batch/lane_run.hpp"
#include "core/base/denormals.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

using simd::lanes;

LaneState::LaneState(const LanePlan& p) : m(p.m), n(p.n), J(p.J) {
  x.resize(std::size_t((J + 1) * m));
  y.resize(std::size_t((J + 1) * n));
}

void LaneState::take(const std::vector<const LaneInput*>& given) {
  inputs = given;
  used = Index(given.size());
  own_sources = std::any_of(given.begin(), given.end(), [&](const auto* i) { return i->sources != given[0]->sources; });
  lost = other = LaneMask{};
  fill_sources();
  start();
}

bool LaneState::shared() const {
  return std::all_of(inputs.begin(), inputs.end(), [&](const LaneInput* i) { return i->plan == inputs[0]->plan; });
}

unsigned LaneState::rigid() const {
  unsigned all = 0;
  for (Index l = 0; l < used; ++l) all |= plan(l).rigid;
  return all;
}

host::StageSteps* LaneState::steps_of(Index lane) {
  const StageProblem& problem = *sources(lane).problem;
  const auto at = std::size_t(own_sources || !shared() ? lane : 0);
  if (!steps[at] || steps_for[at] != &problem) steps[at] = std::make_unique<host::StageSteps>(problem);
  steps_for[at] = &problem;
  return steps[at].get();
}

double LaneState::g_at(Index lane, Index j, Index i) const {
  const LaneSources& s = sources(lane);
  return plan(lane).stages ? s.at_points(j, i) : s.g(j, i);
}

void LaneState::fill_sources() {
  if (!own_sources) return;
  const auto fill = [&](const RowMatrix LaneSources::*table, std::vector<Lanes>& to) {
    const Index size = (sources(0).*table).size();
    to.resize(std::size_t(size));
    for (Index l = 0; l < lanes; ++l) {
      const double* from = (sources(l).*table).data();
      for (Index k = 0; k < size; ++k) to[std::size_t(k)][l] = from[k];
    }
  };
  fill(&LaneSources::drift, own.drift);
  fill(&LaneSources::g, own.g);
  fill(&LaneSources::f, own.f);
  fill(&LaneSources::at_points, own.at_points);
  fill(&LaneSources::growth_drift, own.growth_drift);
}

// x0 and y_0, lane by lane. Lanes without a scene repeat the first one.
void LaneState::start() {
  Vector g(n);
  for (Index l = 0; l < lanes; ++l) {
    const Vector& x0 = input(l).x0;
    for (Index i = 0; i < m; ++i) x[std::size_t(i)][l] = x0[i];
    for (Index i = 0; i < n; ++i) g[i] = g_at(l, 0, i);
    const LaneStart begin = plan(l).start(x0, g);
    for (Index i = 0; i < n; ++i) y[std::size_t(i)][l] = begin.y[i];
    if (!begin.found) lost[l] = -1;
    if (begin.other && l < used) other[l] = -1;
  }
}

LaneMarch::LaneMarch(const LanePlan& plan) : s_(std::make_unique<LaneState>(plan)) {}
LaneMarch::~LaneMarch() = default;

void LaneMarch::run(const std::vector<const LaneInput*>& inputs, std::vector<LaneOutcome>& outcomes) {
  const FlushDenormals flush;
  LaneState& s = *s_;
  s.take(inputs);
  if (s.shared())
    run_lanes<double>(s);
  else
    run_lanes<simd::Lanes>(s);
  outcomes.resize(inputs.size());
  for (std::size_t l = 0; l < inputs.size(); ++l)
    outcomes[l] = {s.lost[Index(l)] == 0, s.other[Index(l)] != 0, s.residual[Index(l)]};
}

namespace {

// Times 10^k, columns of a lane.
double scaled(double value, const std::vector<int>& k, Index i) {
  return k.empty() ? value : times_ten_to(k[std::size_t(i)], value);
}

}  // namespace

void LaneMarch::write_y(Index lane, Eigen::Ref<RowMatrix> y) const {
  const LaneState& s = *s_;
  const std::vector<int>& units = s.plan(lane).units.y;
  double* to = y.data();
  const double* from = reinterpret_cast<const double*>(s.y.data()) + lane;
  if (units.empty())
    for (Index k = 0; k < (s.J + 1) * s.n; ++k) to[k] = from[k * lanes];
  else
    for (Index k = 0; k < (s.J + 1) * s.n; ++k) to[k] = scaled(from[k * lanes], units, k % s.n);
}

void LaneMarch::write_x(Index lane, const std::vector<Index>& components, Eigen::Ref<RowMatrix> x) const {
  const LaneState& s = *s_;
  const std::vector<int>& units = s.plan(lane).units.x;
  const double* from = reinterpret_cast<const double*>(s.x.data()) + lane;
  for (Index j = 0; j <= s.J; ++j)
    for (std::size_t c = 0; c < components.size(); ++c)
      x(j, Index(c)) = scaled(from[(j * s.m + components[c]) * lanes], units, components[c]);
}

void LaneMarch::write_w(Index lane, Eigen::Ref<RowMatrix> w) const {
  const LaneState& s = *s_;
  const LanePlan& p = s.plan(lane);
  const double *x = reinterpret_cast<const double*>(s.x.data()) + lane,
               *y = reinterpret_cast<const double*>(s.y.data()) + lane;
  for (Index j = 0; j <= s.J; ++j)
    for (Index i = 0; i < s.n; ++i) {
      double sum = s.g_at(lane, j, i);
      for (Index k = 0; k < s.m; ++k) sum += p.N(i, k) * x[(j * s.m + k) * lanes];
      for (Index k = 0; k < s.n; ++k) sum += p.M(i, k) * y[(j * s.n + k) * lanes];
      w(j, i) = scaled(sum, p.units.w, i);
    }
}

}  // namespace bromwich
