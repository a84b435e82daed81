#include "batch/lane_plan.hpp"

#include "batch/short_inverse.hpp"
#include "core/host/stage_steps.hpp"
#include "core/kernel/closed_loop.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/resolution.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/lcp/active_set.hpp"
#include "core/march/stages.hpp"
#include "core/numerics/sectorial.hpp"
#include "core/scene/has_impacts.hpp"
#include "core/solve/scaling.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double known_weights = 1e-7;  ///< error of weights, a tenth of what a solve accepts
constexpr double short_series = 1;  ///< h |A| up to which e^{hA} is a series without cancellation: known to rounding
constexpr double rounding_of_time = 1e-11;  ///< eps T |A| from which the rounding of e^{hA} is looked at
constexpr double growth_with_rings = 5e5;   ///< half of what a solve does not doubt where continuous y rings

// False where a set of implicit Euler is singular.
bool add_euler(LanePlan& p) {
  const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(p.m, p.m) - p.h * p.A);
  if (!(lu.rcond() > epsilon)) return false;
  const Matrix decay = lu.inverse(), matrix = p.M + p.N * (p.h * (decay * p.B));
  if (has_one_solution(classify(LcpMatrix(matrix)))) return true;
  EulerSearch& euler = p.euler.emplace();
  euler.seen = p.N * decay;
  for (unsigned set = 0; set < 1u << p.n; ++set) {
    const std::vector<Index> S = members(set, p.n), I = members(~set & ((1u << p.n) - 1), p.n);
    RowMatrix& V = euler.V.emplace_back(RowMatrix::Zero(p.n, p.n));
    for (const Index i : I) V(i, i) = 1;
    if (S.empty()) continue;
    const Eigen::PartialPivLU<Matrix> block(matrix(S, S));
    if (!(block.rcond() > 1e-9)) return false;
    const Matrix inverse = block.inverse();
    V(S, S) = -inverse;
    if (!I.empty()) V(I, S) = -matrix(I, S) * inverse;
  }
  return true;
}

std::string unsuitable(const Scene& scene) {
  if (scene.boundary || !scene.free_rows.empty()) return "boundary values or free rows";
  if (has_impacts(scene) || !scene.cones.empty() || !scene.memories.empty())
    return "impacts with restitution, friction on circles, or modes with memory";
  if (!scene.dynamics->small_state() || scene.dynamics->has_mass()) return "dynamics that are not dense, or have E";
  if (scene.constraints() < 1 || scene.constraints() > largest_tabulated || scene.states() < 1 ||
      scene.states() > most_lane_states)
    return "other sizes";
  return "";
}

// Whether h |Im lambda| <= most for all modes of the closed loop A - B_S M_SS^{-1} N_S: Im lambda is in the numerical
// range of its skew part. False too where this bound does not tell.
bool turns_slowly(const LanePlan& p, unsigned set, double most) {
  if (p.m > most_short || p.n > most_short) return false;
  ShortMatrix inverse, closed = p.A;
  if (set != 0) {
    constexpr double well_known = 1e-7;
    const unsigned all = ~0u;
    if (!(invert(short_block(p.M, set, set), inverse) > well_known)) return false;
    closed -= short_block(p.B, all, set).lazyProduct(ShortMatrix(inverse.lazyProduct(short_block(p.N, set, all))));
  }
  return 0.5 * p.h * (closed - closed.transpose()).cwiseAbs().rowwise().sum().maxCoeff() <= most;
}

// Steps for which a mode with z = h lambda does not count (core/kernel/resolution.cpp), with a margin.
double steps_of_mode(Complex z) {
  constexpr double margin = 0.98;
  double steps = INFINITY;
  if (std::abs(z) > margin * 0.5 && z.real() > margin * 1e-6 * std::abs(z)) steps = margin * 0.1 / z.real();
  if (margin * std::abs(z.real()) < 0.1 * std::abs(z.imag()))
    steps = std::min(steps, margin * 0.4 / std::max(std::abs(radau_damping(z) - z.real()), 1e-300));
  return steps;
}

RowMatrix times(const RowMatrix& table, const Matrix& matrix) { return table * matrix.transpose(); }

// Units of what f is stated by; null: none.
const std::vector<int>* units_of_f(const Scene& scene, const NaturalUnits& units) {
  if (scene.f_entry == SourceEntry::state) return &units.x;
  return scene.f_entry == SourceEntry::through_B ? &units.y : nullptr;
}

}  // namespace

std::optional<SourceSamples> SourceSamples::of(const Scene& scene, Backend& backend, Index J) {
  const DiscreteProblem d = discretise(scene, backend, J, false, nullptr);
  if (d.f.not_finite() >= 0 || d.g.not_finite() >= 0 || d.sources) return std::nullopt;
  StageProblem stages = smooth_stage_problem(d);
  SourceSamples s{d.g.table(), std::move(stages.g), {}, {}, std::move(stages.phi)};
  if (d.f.size() == 0) return s;
  s.f = d.f.table();
  s.f_ends = RowMatrix::Zero(J + 1, 2 * s.f.cols());
  s.f_ends.bottomLeftCorner(J, s.f.cols()) = s.f.topRows(J);
  s.f_ends.rightCols(s.f.cols()) = s.f;
  return s;
}

std::unique_ptr<ActiveSetTable> LanePlan::problem_of(const Matrix& matrix) const {
  return std::make_unique<ActiveSetTable>(matrix, least_elements ? &M : nullptr);
}

double LanePlan::limit_of(unsigned bits) const {
  constexpr double margin = 0.99;
  if (!stages && turns_slowly(*this, bits, margin)) return INFINITY;
  const std::vector<Index> set = members(bits, n);
  const auto closed = closed_matrix(A, B, N, M, set);
  if (!closed || !closed->allFinite()) return stages ? INFINITY : 0;  // stages: no mode of this set is looked at
  const Matrix b = balanced(*closed).A;
  if (!stages && !(0.5 * h * (b - b.transpose()).cwiseAbs().rowwise().sum().maxCoeff() > margin)) return INFINITY;
  double steps = INFINITY;
  const Eigen::EigenSolver<Matrix> eigen(b, false);
  for (const Complex lambda : eigen.eigenvalues())
    if (stages)
      steps = std::min(steps, steps_of_mode(h * lambda));
    else if (h * std::abs(lambda.imag()) > margin && margin * std::abs(lambda.real()) < 0.1 * std::abs(lambda.imag()))
      steps = 0;
  return steps;
}

GrowthMaps LanePlan::growth() const {
  if (stages) return {euler_E, euler_R, euler_E * euler_R, euler_problem.get()};
  return {whole.E, whole.R, whole.E * whole.R + whole.L, whole.problem.get()};
}

double LanePlan::longest(unsigned set) const {
  const std::lock_guard lock(mutex_);
  if (const auto found = longest_.find(set); found != longest_.end()) return found->second;
  return longest_[set] = limit_of(set);
}

std::unique_ptr<LanePlan> LanePlan::make(const Scene& given, Backend& backend, Index J, bool own_sources,
                                         const NaturalUnits* nearby, std::string& why) {
  if (why = unsuitable(given); !why.empty()) return nullptr;
  Scene scene = given;
  if (own_sources) scene.f = {}, scene.g = {}, scene.breakpoints.clear(), scene.breakpoints_are_all = true;
  if (own_sources) scene.x0.setZero();                                 // the start of a scene is none of the plan
  const NaturalUnits units = nearby ? *nearby : natural_units(given);  // as a single solve: e^{hA} keeps more digits
  auto natural = std::make_unique<Scene>(in_natural_units(scene, units));
  const auto family = std::make_shared<GridFamily>();
  const DiscreteProblem d = own_sources ? discretise_maps(*natural, backend, J, *family)
                                        : discretise(*natural, backend, J, false, family.get());
  const std::unique_ptr<TimeOperator> steps = make_time_operator(d);
  const BasisChoice& basis = steps->basis();
  const DenseDynamics& dense = *d.small_state();
  std::unique_ptr<LanePlan> p(new LanePlan);
  p->family_ = family, p->backend_ = &backend;
  p->m = scene.states(), p->n = scene.constraints(), p->J = J, p->h = d.h;
  p->A = dense.A, p->B = dense.B, p->N = dense.N, p->M = to_dense(natural->M);
  p->lcp_class = d.lcp_class;
  p->least_elements = selects_least(d.lcp_class);
  p->surely_P = has_one_solution(d.lcp_class);
  p->has_f_ = bool(given.f);
  const double size = scene.T * p->A.cwiseAbs().colwise().sum().maxCoeff();
  if (!(epsilon * size <= rounding_of_time)) return why = "long times", nullptr;
  if (!own_sources && (d.f.not_finite() >= 0 || d.g.not_finite() >= 0))
    return why = "sources that are not finite", nullptr;
  p->stages = !basis.continuous || basis.rings || basis.only_in_sweeps;
  if (basis.rings) p->most_growth = growth_with_rings;
  p->natural = std::move(natural);
  const bool fine = p->stages ? p->take_stages(d, own_sources, why) : p->take_continuous(d, own_sources, why);
  if (!fine) return nullptr;
  if (p->stages)
    p->units = units;
  else
    p->to_units_of(scene, units), p->make_tables();
  if (own_sources) p->make_maps(given);
  return p;
}

bool LanePlan::take_continuous(const DiscreteProblem& d, bool own_sources, std::string& why) {
  const DenseDynamics& dense = *d.small_state();
  if (!least_elements && !surely_P) return why = "M is of another class than P and Z", false;
  const std::shared_ptr<const StepOperators> step = state_step(d, Rule::exponential);
  if (!(free_growth(d, *step) <= harmless_growth)) return why = "growth of the free state", false;
  if (h * A.cwiseAbs().colwise().sum().maxCoeff() > short_series &&
      check_weights(d, dense_recurrence(dense, *step), INFINITY).error > known_weights)
    return why = "weights that are not known well", false;
  whole.E = step->decay, whole.L = step->left * B, whole.R = step->right * B;
  if (surely_P && !has_one_solution(classify(LcpMatrix(Matrix(M + N * whole.R)))))
    return why = "steps of another class than P", false;
  if (least_elements && !look_for_others(why)) return false;
  F_ = source_matrix(d), drive_left_ = step->left * F_, drive_right_ = step->right * F_;
  if (own_sources) return true;
  sources = tables(d);
  return !d.sources || add_parts(d, why);
}

// A single solve looks for other solutions of these scenes.
bool LanePlan::look_for_others(std::string& why) {
  if (!selects_least_norm(lcp_class)) others.emplace(M);
  if (add_euler(*this)) return true;
  why = "steps that may have several solutions";
  return false;
}

bool LanePlan::take_stages(const DiscreteProblem& d, bool own_sources, std::string& why) {
  if (2 * n > largest_tabulated) return why = "stages of more than four constraints", false;
  if (d.sources) return why = "stages with sources that are not smooth", false;
  if (!has_euler_step(A, h)) return why = "a step of implicit Euler is singular", false;
  F_ = source_matrix(d);
  StageProblem problem = stage_problem({});
  if (!has_f_) problem.F = {};
  host::DenseStageMaps maps = host::dense_stage_maps(problem, *d.small_state(), 2, h, {});
  whole.E = maps.decay, whole.L = maps.see, whole.R = maps.drive;
  push_ = std::move(maps.push), seen_push_ = std::move(maps.seen_push);
  Matrix steps = maps.implicit;
  for (const Index k : {Index(0), n}) steps.block(k, k, n, n) += M;
  steps.topRows(n) *= 0.75, steps.bottomRows(n) *= 0.25;
  const LcpClass of_steps = classify(LcpMatrix(steps));
  if (!has_convex_solutions(of_steps)) return why = "steps whose class does not determine a solution", false;
  certain = has_one_solution(of_steps);
  whole.problem = std::make_unique<ActiveSetTable>(steps, nullptr);
  const std::shared_ptr<const StepOperators> euler_step = state_step(d, Rule::implicit_euler);
  euler_E = euler_step->decay, euler_R = euler_step->right * B;
  euler_problem = std::make_unique<ActiveSetTable>(M + N * euler_R, nullptr);
  if ((selects_least(lcp_class) || !selects_one(lcp_class)) && !look_for_others(why)) return false;
  drive_right_ = euler_step->right * F_;
  const std::vector<bool> position =
      host::StageSteps::rigid_constraints(natural->dynamics->outputs(), natural->dynamics->rates_of_inputs(h), M);
  for (std::size_t i = 0; i < position.size(); ++i) rigid |= position[i] ? 1u << i : 0u;
  if (!own_sources) sources = tables(d);
  return true;
}

// In the units of d. Precondition: no rough steps that matter to stages.
LaneSources LanePlan::tables(const DiscreteProblem& d) const {
  const RowMatrix f = d.f.size() > 0 ? RowMatrix(d.f.table()) : RowMatrix();
  LaneSources s;
  if (!stages) {
    s.g = d.g.table();
    s.drift = f.size() > 0 ? times(f, drive_right_) : RowMatrix::Zero(J + 1, m);
    if (f.size() > 0) s.drift.bottomRows(J) += times(f.topRows(J), drive_left_);
    if (euler) s.f = f.size() > 0 ? times(f, F_) : RowMatrix::Zero(J + 1, m);
    return s;
  }
  s.f = f.size() > 0 ? times(f, F_) : RowMatrix::Zero(J + 1, m);
  s.problem = smooth_stage_problem(d);
  std::vector<Index> rows(std::size_t(J) + 1);
  for (Index j = 0; j <= J; ++j) rows[std::size_t(j)] = j;
  host::DenseStageMaps maps = host::dense_stage_maps(*s.problem, *d.small_state(), 2, h, rows);
  s.g = std::move(maps.q);
  s.drift = maps.forcing.size() > 0 ? std::move(maps.forcing) : RowMatrix(RowMatrix::Zero(J + 1, m));
  s.at_points = d.g.table();
  s.growth_drift = f.size() > 0 ? times(f, drive_right_) : RowMatrix::Zero(J + 1, m);
  return s;
}

// f of the scene is given in its units, which the columns of the maps take to those of the plan.
void LanePlan::make_maps(const Scene& scene) {
  maps.g = Vector::Ones(n);
  for (Index i = 0; i < n && !units.trivial(); ++i) maps.g[i] = times_ten_to(-units.w[std::size_t(i)], 1);
  if (!has_f_) return;
  const Index k = F_.cols();
  maps.f = F_;
  if (stages) {
    maps.drift = push_, maps.q = seen_push_, maps.growth = drive_right_;
  } else {
    maps.drift.resize(m, 2 * k);
    maps.drift << drive_left_, drive_right_;
  }
  const std::vector<int>* of_f = units.trivial() ? nullptr : units_of_f(scene, units);
  for (RowMatrix* map : {&maps.drift, &maps.q, &maps.growth, &maps.f})
    for (Index c = 0; c < map->cols() && of_f; ++c)
      for (double& entry : map->col(c)) entry = times_ten_to(-(*of_f)[std::size_t(c % k)], entry);
}

StageProblem LanePlan::stage_problem(const SourceSamples& samples) const {
  StageProblem p;
  p.dynamics = &natural->dynamics, p.M = &natural->M;
  p.lcp_class = lcp_class;
  p.h = h;
  p.x0 = natural->x0;
  p.F = F_.sparseView();
  const auto in_units = [](RowMatrix& table, const std::vector<int>* of) {
    for (Index c = 0; c < table.cols() && of && !of->empty(); ++c)
      for (double& entry : table.col(c)) entry = times_ten_to(-(*of)[std::size_t(c) % of->size()], entry);
  };
  p.g = samples.g_stages, p.phi = samples.f_stages;
  in_units(p.g, &units.w), in_units(p.phi, units_of_f(*natural, units));
  return p;
}

std::optional<LaneSources> LanePlan::sources_of(const Scene& given) const {
  Scene scene = in_natural_units(given, units);  // those of the scene without stages
  if (stages) scene.dynamics = natural->dynamics;
  const DiscreteProblem d = discretise(scene, *backend_, J, false, family_.get());
  if (d.f.not_finite() >= 0 || d.g.not_finite() >= 0 || d.sources) return std::nullopt;
  LaneSources s = tables(d);
  if (s.problem) s.problem->dynamics = &natural->dynamics, s.problem->M = &natural->M;
  return s;
}

Vector LaneInput::g_at(Index j) const {
  if (samples) return plan->maps.g.cwiseProduct(samples->g.row(j).transpose());
  const LaneSources& s = tables();
  return (plan->stages ? s.at_points : s.g).row(j).transpose();
}

Vector LanePlan::start_of(Vector x0) const {
  for (Index i = 0; i < x0.size() && !units.trivial(); ++i) x0[i] = times_ten_to(-units.x[std::size_t(i)], x0[i]);
  return x0;
}

LaneStart LanePlan::start(const Vector& x0, const Vector& g) const {
  LaneStart start;
  const Vector begin = N * x0 + g, terms = N.cwiseAbs() * x0.cwiseAbs() + g.cwiseAbs();
  Vector q = begin;
  const double share = 4 * double(m + 1) * epsilon;  // as core/march/outcome.cpp
  for (Index i = 0; i < n; ++i)
    if (begin[i] < 0 && begin[i] >= -share * terms[i]) q[i] = 0;
  start.y = Vector::Zero(n);
  if (at_zero) {
    double value[largest_tabulated] = {};
    unsigned set = 0;
    start.found = at_zero->solve(q.data(), set, value);
    for (Index i = 0; i < n && start.found; ++i)
      if (set >> i & 1u) start.y[i] = std::max(at_zero->column_scale(i) * value[i], 0.0);
  } else {
    start.found = ActiveSetLcp(M, lcp_class).solve(q, start.y).solved;
    if (!start.found) start.y.setZero();
  }
  start.other = start.found && others && others->any(begin, start.y);
  return start;
}

// With continuous y, in the units of the scene.
void LanePlan::make_tables() {
  whole.problem = problem_of(M + N * whole.R);
  at_zero = problem_of(M);
}

// From natural units to those of the scene.
void LanePlan::to_units_of(const Scene& scene, const NaturalUnits& given) {
  if (given.trivial()) return;
  const auto scale = [](auto& matrix, const std::vector<int>& rows, const std::vector<int>* columns) {
    for (Index i = 0; i < matrix.rows(); ++i)
      for (Index k = 0; k < matrix.cols(); ++k)
        matrix(i, k) = times_ten_to(rows[std::size_t(i)] - (columns ? (*columns)[std::size_t(k)] : 0), matrix(i, k));
  };
  const auto scale_rows = [](RowMatrix& table, const std::vector<int>& k) {
    for (Index j = 0; j < table.rows(); ++j)
      for (Index i = 0; i < table.cols(); ++i) table(j, i) = times_ten_to(k[std::size_t(i)], table(j, i));
  };
  const DenseDynamics& d = *scene.dynamics->small_state();
  A = d.A, B = d.B, N = d.N, M = to_dense(scene.M);
  const auto restate = [&](StepMaps& maps) {
    scale(maps.E, given.x, &given.x), scale(maps.L, given.x, &given.y), scale(maps.R, given.x, &given.y);
  };
  restate(whole);
  for (StepMaps& maps : maps_of_parts) {
    if (maps.R.size() > 0) restate(maps);
    maps.problem = problem_of(maps.R.size() > 0 ? Matrix(M + N * maps.R) : M);
  }
  if (others) others.emplace(M);
  if (euler) add_euler(*this);
  const std::vector<int>* of_f = units_of_f(scene, given);
  for (Matrix* matrix : {&F_, &drive_left_, &drive_right_}) scale(*matrix, given.x, of_f);
  scale_rows(sources.drift, given.x), scale_rows(sources.f, given.x), scale_rows(sources.g, given.w);
  for (auto& [step, all] : parts)
    for (PartOfStep& part : all) scale(part.drift, given.x, nullptr), scale(part.g, given.w, nullptr);
}

}  // namespace bromwich
