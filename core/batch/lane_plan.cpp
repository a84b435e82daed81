#include "core/batch/lane_march.hpp"

#include "core/kernel/closed_loop.hpp"
#include "core/kernel/resolution.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/numerics/sectorial.hpp"
#include "core/numerics/step_propagator.hpp"
#include "core/solve/scaling.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_limit = 1e-9;         ///< of limits of g, as in core/march/split.cpp
constexpr std::size_t most_parts = 200;     ///< with maps of their own
constexpr double followed_sources = 0.01;   ///< error of parts above which a result has a warning
constexpr double known_weights = 1e-7;      ///< error of weights, a tenth of what a solve accepts
constexpr double rounding_of_time = 1e-11;  ///< eps T |A| from which the rounding of e^{hA} is looked at

std::unique_ptr<ActiveSetTable> problem_of(const LanePlan& p, const Matrix& matrix) {
  return std::make_unique<ActiveSetTable>(matrix, p.least_elements ? &p.M : nullptr);
}

// False where a set of implicit Euler is singular.
bool add_euler(LanePlan& p) {
  const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(p.m, p.m) - p.h * p.A);
  if (!(lu.rcond() > epsilon)) return false;
  const Matrix decay = lu.inverse(), matrix = p.M + p.N * (p.h * (decay * p.B));
  if (classify(LcpMatrix(matrix)) == LcpClass::P) return true;
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
  if (!scene.dynamics->small_state() || scene.dynamics->has_mass()) return "dynamics that are not dense, or have E";
  if (scene.constraints() < 1 || scene.constraints() > largest_tabulated || scene.states() < 1 ||
      scene.states() > most_lane_states)
    return "other sizes";
  return "";
}

}  // namespace

bool LanePlan::oscillates(unsigned set) const {
  constexpr double margin = 0.99;
  const std::lock_guard lock(mutex_);
  if (const auto found = oscillating_.find(set); found != oscillating_.end()) return found->second;
  bool yes = false;
  if (const auto closed = closed_matrix(A, B, N, M, members(set, n)); closed && closed->allFinite()) {
    const Matrix b = balanced(*closed).A;
    if (0.5 * h * (b - b.transpose()).cwiseAbs().rowwise().sum().maxCoeff() > margin) {
      const Eigen::EigenSolver<Matrix> eigen(b, false);
      for (const Complex lambda : eigen.eigenvalues())
        yes = yes || (h * std::abs(lambda.imag()) > margin &&
                      margin * std::abs(lambda.real()) < 0.1 * std::abs(lambda.imag()));
    }
  } else {
    yes = true;
  }
  return oscillating_[set] = yes;
}

std::unique_ptr<LanePlan> LanePlan::make(const Scene& given, Backend& backend, Index J, bool own_sources,
                                         std::string& why) {
  if (why = unsuitable(given); !why.empty()) return nullptr;
  Scene scene = given;
  if (own_sources) scene.f = {}, scene.g = {}, scene.breakpoints.clear();
  const NaturalUnits units = natural_units(scene);  // as a single solve: e^{hA} keeps more digits in them
  const Scene natural = in_natural_units(scene, units);
  Methods methods(natural, backend, J, {});
  const DiscreteProblem& d = methods.problem();
  const DenseDynamics& dense = *d.small_state();
  std::unique_ptr<LanePlan> p(new LanePlan);
  p->m = scene.states(), p->n = scene.constraints(), p->J = J, p->h = d.h, p->t = d.t;
  p->A = dense.A, p->B = dense.B, p->N = dense.N, p->M = to_dense(natural.M);
  p->least_elements = d.lcp_class == LcpClass::Z;
  p->surely_P = d.lcp_class == LcpClass::P;
  const auto refused = [&](const char* reason) {
    why = reason;
    return nullptr;
  };
  if (!p->least_elements && !p->surely_P) return refused("M is of another class than P and Z");
  if (!methods.basis().continuous || methods.basis().rings) return refused("steps of Radau IIA");
  const std::shared_ptr<const StepOperators> step = state_step(d, Rule::exponential);
  const double size = scene.T * p->A.cwiseAbs().colwise().sum().maxCoeff();
  if (!(epsilon * size <= rounding_of_time) || !(free_growth(d, *step) <= harmless_growth))
    return refused("growth of the free state, or long times");
  if (check_weights(d, dense_recurrence(dense, *step), INFINITY).error > known_weights)
    return refused("weights that are not known well");
  p->whole.E = step->decay, p->whole.L = step->left * p->B, p->whole.R = step->right * p->B;
  p->whole.problem = problem_of(*p, p->M + p->N * p->whole.R);
  p->at_zero = problem_of(*p, p->M);
  if (p->surely_P && classify(LcpMatrix(p->whole.problem->matrix())) != LcpClass::P)
    return refused("steps of another class than P");
  if (p->least_elements) {  // a single solve looks for other solutions of these scenes
    p->others.emplace(p->M);
    if (!add_euler(*p)) return refused("steps that may have several solutions");
  }
  const Matrix F = source_matrix(d);
  p->F = F, p->drive_left = step->left * F, p->drive_right = step->right * F;
  if (own_sources) {
    p->to_units_of(scene, units);
    return p;
  }
  if (d.f.not_finite() >= 0 || d.g.not_finite() >= 0) return refused("sources that are not finite");
  p->g = d.g.table();
  p->drift = p->f = RowMatrix::Zero(J + 1, p->m);
  if (d.f.size() > 0) {
    p->f = d.f.table() * F.transpose();
    p->drift = d.f.table() * p->drive_right.transpose();
    p->drift.bottomRows(J) += d.f.table().topRows(J) * p->drive_left.transpose();
  }
  if (d.sources && !p->add_parts(d, why)) return nullptr;
  p->to_units_of(scene, units);
  return p;
}

// From natural units to those of the scene.
void LanePlan::to_units_of(const Scene& scene, const NaturalUnits& units) {
  if (units.trivial()) return;
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
    if (maps.R.size() > 0) {
      scale(maps.E, units.x, &units.x), scale(maps.L, units.x, &units.y), scale(maps.R, units.x, &units.y);
      maps.problem = problem_of(*this, M + N * maps.R);
    } else {
      maps.problem = problem_of(*this, M);
    }
  };
  restate(whole);
  for (StepMaps& maps : maps_of_parts) restate(maps);
  at_zero = problem_of(*this, M);
  if (others) others.emplace(M);
  if (euler) add_euler(*this);
  const std::vector<int>* of_f = scene.f_entry == SourceEntry::state       ? &units.x
                                 : scene.f_entry == SourceEntry::through_B ? &units.y
                                                                           : nullptr;
  for (Matrix* matrix : {&F, &drive_left, &drive_right}) scale(*matrix, units.x, of_f);
  scale_rows(drift, units.x), scale_rows(f, units.x), scale_rows(g, units.w);
  for (auto& [step, all] : parts)
    for (PartOfStep& part : all) scale(part.drift, units.x, nullptr), scale(part.g, units.w, nullptr);
}

// As core/march/split.cpp takes them.
bool LanePlan::add_parts(const DiscreteProblem& d, std::string& why) {
  const SourceSteps& s = *d.sources;
  if (s.unresolved > 0 || s.disagreement > followed_sources) {
    why = "sources that the steps do not resolve";
    return false;
  }
  StepPropagator propagator(A, h);
  const OneSided values(d.scene.g, n, s.resolution);
  const double g_scale = std::max(d.g.values().size() > 0 ? d.g.values().cwiseAbs().maxCoeff() : 0, 1e-290);
  Matrix F;
  if (d.f.size() > 0) F = source_matrix(d);
  if (d.f.shapes().size() > 0) F = (F * d.f.shapes()).eval();
  std::map<long long, const StepMaps*> known;
  StepMaps& jump = maps_of_parts.emplace_back();
  jump.problem = problem_of(*this, M);
  const auto maps_of = [&](double length) {
    const StepMaps*& found = known[std::llround(std::ldexp(length / h, 40))];
    if (found) return found;
    StepMaps& made = maps_of_parts.emplace_back();
    const Matrix none = Matrix::Zero(m, m), no_y = Matrix::Zero(m, n);
    made.E = Matrix::Identity(m, m), made.L = no_y, made.R = no_y;
    propagator.advance(length, {none, none, none}, made.E);
    propagator.advance(length, {B, -B, no_y}, made.L);
    propagator.advance(length, {no_y, B, no_y}, made.R);
    made.problem = problem_of(*this, M + N * made.R);
    return found = &made;
  };
  for (const RoughStep& rough : s.rough) {
    std::vector<PartOfStep>& steps = parts[rough.step];
    Vector before = d.g.row(rough.step - 1);
    const auto restart = [&](const Vector& after) {
      if ((before - after).cwiseAbs().maxCoeff() > same_limit * g_scale)
        steps.push_back({&jump, false, Vector::Zero(m), after});
    };
    double from = d.t[rough.step - 1];
    std::size_t piece = 0;
    for (const double to : rough.ends) {
      const double length = to - from;
      if (d.scene.g) restart(values.whole(values.after(from, length)));
      before = d.scene.g ? values.whole(values.before(to, length)) : Vector(Vector::Zero(n));
      Matrix x = Matrix::Zero(m, 1);
      for (; piece < rough.pieces.size() && rough.pieces[piece].start < to; ++piece) {
        const Matrix f = F * rough.pieces[piece].phi;
        propagator.advance(rough.pieces[piece].length, {f.col(0), f.col(1), f.col(2)}, x);
      }
      steps.push_back({maps_of(length), true, x, before});
      if (known.size() > most_parts) return why = "sources that are rough in many steps", false;
      from = to;
    }
    restart(d.g.row(rough.step));
  }
  for (const StepMaps& maps : maps_of_parts)
    if (surely_P && maps.R.size() > 0 && classify(LcpMatrix(maps.problem->matrix())) != LcpClass::P)
      return why = "parts of steps of another class than P", false;
  return true;
}

}  // namespace bromwich
