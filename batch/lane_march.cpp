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
  lost = other = LaneMask{};
  if (samples()) single_ = {};
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

host::StageSteps& LaneState::steps_of(Index lane) {
  const bool one_for_all = shared() && !samples() && !have_own_tables();
  SingleSteps& single = single_[std::size_t(one_for_all ? 0 : lane)];
  if (samples() && !single.steps) single.own = plan(lane).stage_problem(*samples());
  const StageProblem& problem = samples() ? single.own : *tables(lane).problem;
  if (single.of != &problem) single.steps = std::make_unique<host::StageSteps>(problem);
  single.of = &problem;
  return *single.steps;
}

bool LaneState::have_own_tables() const {
  return std::any_of(inputs.begin(), inputs.end(), [&](const auto* i) { return i->sources != inputs[0]->sources; });
}

namespace {

template <class Get>
void put_side_by_side(const Get& get, std::vector<simd::Lanes>& to) {
  to.resize(std::size_t(get(0).size()));
  for (Index l = 0; l < lanes; ++l) {
    const double* from = get(l).data();
    for (std::size_t k = 0; k < to.size(); ++k) to[k][l] = from[k];
  }
}

}  // namespace

void LaneState::fill(RowMatrix LaneSources::*table, std::vector<Lanes>& to) {
  put_side_by_side([&](Index l) -> const RowMatrix& { return tables(l).*table; }, to);
}

void LaneState::fill(RowMatrix SourceMaps::*map, std::vector<Lanes>& to) {
  put_side_by_side([&](Index l) -> const RowMatrix& { return plan(l).maps.*map; }, to);
}

LaneState::Sources LaneState::sources() {
  using Source = scene_steps::Source<Lanes>;
  const bool stages = plan(0).stages;
  if (const SourceSamples* s = samples()) {
    fill(&SourceMaps::drift, maps_.drift), fill(&SourceMaps::q, maps_.q);
    fill(&SourceMaps::growth, maps_.growth), fill(&SourceMaps::f, maps_.f);
    put_side_by_side([&](Index l) -> const Vector& { return plan(l).maps.g; }, maps_.g);
    maps_.g.insert(maps_.g.end(), maps_.g.begin(), maps_.g.begin() + n);  // of both stages
    const RowMatrix& of_steps = stages ? s->f_stages : s->f_ends;
    const auto mapped = [&](const RowMatrix* shared, const std::vector<Lanes>& map, const RowMatrix& samples,
                            Index width) {
      return Source{shared ? shared->data() : nullptr,
                    nullptr,
                    width,
                    1,
                    {map.data(), maps_.g.data(), samples.data(), samples.cols(), shared && stages}};
    };
    const Source drift = mapped(nullptr, maps_.drift, of_steps, m), at_points = mapped(&s->g, {}, {}, n);
    return {drift, stages ? mapped(&s->g_stages, maps_.q, of_steps, 2 * n) : at_points, at_points,
            stages ? mapped(nullptr, maps_.growth, s->f, m) : drift, mapped(nullptr, maps_.f, s->f, m)};
  }
  const bool own = have_own_tables();
  const auto table = [&](RowMatrix LaneSources::*of, std::vector<Lanes>& beside, Index width) {
    if (own) fill(of, beside);
    return Source{(tables(0).*of).data(), own ? beside.data() : nullptr, width, 1};
  };
  const Source drift = table(&LaneSources::drift, beside_.drift, m),
               g = table(&LaneSources::g, beside_.g, stages ? 2 * n : n), f = table(&LaneSources::f, beside_.f, m);
  if (!stages) return {drift, g, g, drift, f};
  return {drift, g, table(&LaneSources::at_points, beside_.at_points, n),
          table(&LaneSources::growth_drift, beside_.growth_drift, m), f};
}

// x0 and y_0, lane by lane. Lanes without a scene repeat the first one.
void LaneState::start() {
  for (Index l = 0; l < lanes; ++l) {
    const Vector& x0 = input(l).x0;
    for (Index i = 0; i < m; ++i) x[std::size_t(i)][l] = x0[i];
    const LaneStart begin = plan(l).start(x0, input(l).g_at(0));
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

void LaneMarch::write_y(Index lane, const std::vector<Index>& rows, Eigen::Ref<RowMatrix> y) const {
  const LaneState& s = *s_;
  const std::vector<int>& units = s.plan(lane).units.y;
  const double* from = reinterpret_cast<const double*>(s.y.data()) + lane;
  double* to = y.data();
  for (const Index j : rows)
    for (Index i = 0; i < s.n; ++i) *to++ = scaled(from[(j * s.n + i) * lanes], units, i);
}

void LaneMarch::write_x(Index lane, const std::vector<Index>& rows, const std::vector<Index>& components,
                        Eigen::Ref<RowMatrix> x) const {
  const LaneState& s = *s_;
  const std::vector<int>& units = s.plan(lane).units.x;
  const double* from = reinterpret_cast<const double*>(s.x.data()) + lane;
  double* to = x.data();
  for (const Index j : rows)
    for (const Index i : components) *to++ = scaled(from[(j * s.m + i) * lanes], units, i);
}

void LaneMarch::write_w(Index lane, const std::vector<Index>& rows, Eigen::Ref<RowMatrix> w) const {
  const LaneState& s = *s_;
  const LanePlan& p = s.plan(lane);
  const double *x = reinterpret_cast<const double*>(s.x.data()) + lane,
               *y = reinterpret_cast<const double*>(s.y.data()) + lane;
  double* to = w.data();
  for (const Index j : rows) {
    const Vector g = s.input(lane).g_at(j);
    for (Index i = 0; i < s.n; ++i) {
      double sum = g[i];
      for (Index k = 0; k < s.m; ++k) sum += p.N(i, k) * x[(j * s.m + k) * lanes];
      for (Index k = 0; k < s.n; ++k) sum += p.M(i, k) * y[(j * s.n + k) * lanes];
      *to++ = scaled(sum, p.units.w, i);
    }
  }
}

}  // namespace bromwich
