#include "core/march/settled_y.hpp"

#include "core/lcp/active_set.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

namespace bromwich {

namespace {

constexpr double part_of_a_step = 1.0 / 64;
constexpr double accepted_residual = 1e-10;  ///< of the problem at the time point
constexpr double counts_as_zero = 1e-9;      ///< y relative to the largest one, and w to its terms
constexpr Index most_settled_constraints = 128, most_settled_states = 20000;

// A step of implicit Euler from x: q = N (E/d - A)^{-1} (E x/d + f) + g, matrix M + N (E/d - A)^{-1} B.
struct BriefStep {
  double length;
  std::unique_ptr<ShiftedSystem<double>> shifted;
  ActiveSetLcp lcp;
};

std::optional<BriefStep> brief_step(const LinearSystem& dynamics, const Matrix& M, double length) {
  auto shifted = dynamics.at_shift(1 / length);
  if (!shifted) return std::nullopt;
  const Matrix implicit = M + dynamics.outputs() * shifted->solve(Matrix(dynamics.inputs()));
  if (!implicit.allFinite()) return std::nullopt;
  const LcpClass lcp_class = classify(LcpMatrix(implicit));
  if (!has_convex_solutions(lcp_class)) return std::nullopt;
  return BriefStep{length, std::move(shifted), ActiveSetLcp(implicit, lcp_class)};
}

// A constraint of positions is passed with a velocity: y of a brief step behind the contact is its impulse.
bool has_rigid_constraint(const LinearSystem& dynamics, const Matrix& M, double h) {
  const SparseMatrix B = dynamics.rates_of_inputs(h);
  const Eigen::SparseMatrix<double, Eigen::RowMajor> N = dynamics.outputs();
  for (Index i = 0; i < M.rows(); ++i) {
    const double first = N.row(i).dot(B.col(i)), terms = N.row(i).cwiseAbs().dot(B.col(i).cwiseAbs());
    if (M(i, i) == 0 && std::abs(first) <= counts_as_zero * terms) return true;
  }
  return false;
}

}  // namespace

struct SettledY::Brief {
  Brief(const DiscreteProblem& problem, const LinearSystem& system, const SparseMatrix& of_f)
      : p(problem),
        dynamics(system),
        F(of_f),
        M(to_dense(p.scene.M)),
        resolution(p.sources ? p.sources->resolution : 256 * epsilon * p.scene.T),
        f(p.scene.f, p.scene.f ? p.scene.sources() : 0, resolution),
        g(p.scene.g, p.scene.g ? p.scene.constraints() : 0, resolution) {
    if (has_rigid_constraint(dynamics, M, p.h)) return;
    for (std::size_t k = 0; k < steps.size(); ++k)
      steps[k] = brief_step(dynamics, M, double(k + 1) * part_of_a_step * p.h);
  }

  // y at row j, which has been `y`; empty: unknown.
  std::optional<Vector> settled(Index j, const Vector& x, const Vector& y) {
    if (!steps[0] || !steps[1] || meets_breakpoint(j)) return std::nullopt;
    Vector soon, later;
    if (!take(*steps[0], j, x, y, soon) || !take(*steps[1], j, x, soon, later)) return std::nullopt;
    const bool same = ((soon.array() > 0) == (later.array() > 0)).all();
    return on_constraints(j, x, same ? Vector((2 * soon - later).cwiseMax(0)) : soon);
  }

  bool meets_breakpoint(Index j) const {
    const double part = 2 * part_of_a_step * p.h;
    const double from = j < p.J ? p.t[j] + resolution : p.t[j] - part, to = from + part;
    const auto next = std::lower_bound(p.scene.breakpoints.begin(), p.scene.breakpoints.end(), from);
    return next != p.scene.breakpoints.end() && *next <= to;
  }

  // The source `ahead` of row j. Behind T it goes on as a line.
  Vector source(const OneSided& s, Index j, double ahead) const {
    Vector value, before;
    s.value(j < p.J ? p.t[j] + ahead : p.t[j], value);
    if (j < p.J) return s.whole(value);
    s.value(p.t[j] - ahead, before);
    return s.whole(2 * value - before);
  }

  bool take(BriefStep& step, Index j, const Vector& x, const Vector& guess, Vector& y) const {
    Vector moved = dynamics.times_mass(x) / step.length;
    if (F.size() > 0) moved += F * source(f, j, step.length);
    Vector q = dynamics.observe(step.shifted->solve(moved));
    if (p.scene.g) q += source(g, j, step.length);
    step.lcp.start_from(guess);
    return q.allFinite() && step.lcp.solve(q, y).solved;
  }

  // The nearest y of the same active set that solves the problem at row j.
  std::optional<Vector> on_constraints(Index j, const Vector& x, Vector y) const {
    const Vector q = dynamics.observe(x) + p.g.row(j);
    std::vector<Index> active;
    for (Index i = 0; i < y.size(); ++i)
      if (y[i] > 0) active.push_back(i);
    if (!active.empty()) {
      const Matrix own = M(active, active);
      const Vector off = (M * y + q)(active);
      y(active) -= own.completeOrthogonalDecomposition().solve(off);
    }
    y = y.cwiseMax(0);
    const Vector w = M * y + q;
    const double missed = y.cwiseMin(w).cwiseAbs().maxCoeff(), size = std::max(1.0, q.cwiseAbs().maxCoeff());
    return missed <= accepted_residual * size ? std::optional(y) : std::nullopt;
  }

  const DiscreteProblem& p;
  const LinearSystem& dynamics;
  const SparseMatrix& F;
  Matrix M;
  double resolution;
  OneSided f, g;
  std::array<std::optional<BriefStep>, 2> steps;
};

SettledY::SettledY(const DiscreteProblem& p, const LinearSystem& dynamics, const SparseMatrix& F)
    : p_(p), dynamics_(dynamics), F_(F) {}

SettledY::~SettledY() = default;

// y_0 of least norm is one of several where w is zero, too.
bool SettledY::is_open_at_zero(const Vector& y) const {
  const Vector w = p_.start + multiply(p_.scene.M, y), terms = p_.start.cwiseAbs() + w.cwiseAbs();
  const double size = std::max(terms.maxCoeff(), dynamics_.observed_terms(p_.scene.x0).maxCoeff());
  return ((y.array() <= 0) && (w.array() <= counts_as_zero * size)).any();
}

void SettledY::operator()(Index j, const Vector& x, Eigen::Ref<Vector> y) {
  if (j == 0 || before_.size() != y.size()) largest_ = 0;
  if (y.allFinite()) largest_ = std::max(largest_, y.cwiseAbs().maxCoeff());
  const Eigen::Array<bool, Eigen::Dynamic, 1> active = y.array() > counts_as_zero * largest_;
  const bool switches = j > 0 && (active != before_).any(), rough = j > 0 && p_.sources && p_.sources->at(j);
  before_ = active;
  if (!y.allFinite() || !(j == 0 ? is_open_at_zero(y) : switches || rough)) return;
  if (!brief_) brief_ = std::make_unique<Brief>(p_, dynamics_, F_);
  if (const auto settled = brief_->settled(j, x, y)) y = *settled;
}

bool settles_y(const DiscreteProblem& p) {
  return !has_one_solution(p.lcp_class) && p.scene.constraints() <= most_settled_constraints &&
         p.scene.states() <= most_settled_states;
}

}  // namespace bromwich
