#include "core/shooting/flow_derivative.hpp"

#include "core/events/collocation.hpp"
#include "core/events/switched_system.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/shooting/extremes.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr std::size_t most_propagators = 20000;  ///< kept: pieces between switches have lengths that do not recur

// Where on its polynomials a piece ends.
double end_of(const EventPiece& p) { return std::min(1.0, (p.end - p.begin) / p.length); }

Vector rate_at(const EventPiece& p, double at) {
  return p.x.transpose() * (Collocation::get().derivative.transpose() * legendre(at)) / p.length;
}

}  // namespace

FlowDerivative::FlowDerivative(const Scene& scene) : scene_(scene) {}

FlowDerivative::System& FlowDerivative::system_of(const EventPiece& p) {
  const auto known = systems_.find(p.modes);
  return known != systems_.end() ? known->second : systems_.try_emplace(p.modes, scene_, p.modes).first->second;
}

const SwitchedMode* FlowDerivative::mode_of(const EventPiece& p, const std::vector<Index>& active) {
  System& system = system_of(p);
  auto known = system.sets.find(active);
  if (known == system.sets.end())
    known = system.sets.emplace(active, make_switched_mode(system.regime.system, active)).first;
  return known->second ? &*known->second : nullptr;
}

const Matrix& FlowDerivative::propagator(const SwitchedMode* mode, double length) {
  const auto key = std::make_pair(mode, std::llround(std::ldexp(length / scene_.T, 48)));
  if (const auto known = propagators_.find(key); known != propagators_.end()) return known->second;
  if (propagators_.size() >= most_propagators) propagators_.clear();
  return propagators_.emplace(key, matrix_phi(length * mode->A).exponential).first->second;
}

Matrix FlowDerivative::at_end(const EventSolution& s) {
  return carried(s, Matrix::Identity(scene_.states(), scene_.states()), {});
}

FlowChange FlowDerivative::along(const EventSolution& s, const Vector& dx0) {
  FlowChange most{dx0.cwiseAbs(), Vector::Zero(scene_.constraints())};
  carried(s, dx0, [&most](const EventPiece&, const SwitchedMode& mode, bool, const Matrix& dx) {
    most.x = most.x.cwiseMax(dx.col(0).cwiseAbs());
    most.y = most.y.cwiseMax((mode.y.x * dx.col(0)).cwiseAbs());
  });
  return most;
}

FlowMargins FlowDerivative::margins(const EventSolution& s, const Matrix& dx0) {
  const Index n = scene_.constraints();
  std::vector<char> ever(std::size_t(n), 0), always(std::size_t(n), 1);
  FlowMargins all{Vector::Constant(n, INFINITY), Matrix::Zero(n, dx0.cols())};
  carried(s, dx0, [&](const EventPiece& p, const SwitchedMode& mode, bool end, const Matrix& dx) {
    if (end) return;
    const Matrix of_y = mode.y.x * dx, of_w = mode.w.x * dx;
    for (Index i = 0; i < n; ++i) {
      const bool active = std::binary_search(p.active.begin(), p.active.end(), i);
      (active ? ever : always)[std::size_t(i)] = active;
      const Vector c = values_of(p, i, active);
      const double least = extremes_of(c, end_of(p)).least;
      if (!(least < all.least[i])) continue;
      all.least[i] = least;
      all.change.row(i) = (active ? of_y : of_w).row(i);
    }
  });
  std::vector<Index> kept;
  for (Index i = 0; i < n; ++i)
    if (ever[std::size_t(i)] == always[std::size_t(i)]) kept.push_back(i);
  return {all.least(kept), all.change(kept, Eigen::all)};
}

Matrix FlowDerivative::carried(const EventSolution& s, Matrix dx, const Note& note) {
  for (const Memory& memory : scene_.memories) dx.row(memory.state).setZero();
  const EventPiece* before = nullptr;
  for (const EventPiece& p : s.pieces) {
    const SwitchedMode* mode = p.passed ? nullptr : mode_of(p, p.active);
    if (mode) {
      pass(before, p, dx);
      if (mode->constraints.x.rows() > 0)
        dx += system_of(p).regime.system.B * (mode->impulse * (mode->constraints.x * dx));
      if (note) note(p, *mode, false, dx);
      dx = propagator(mode, p.end - p.begin) * dx;
      if (note) note(p, *mode, true, dx);
    }
    before = p.passed ? nullptr : &p;
  }
  return dx;
}

void FlowDerivative::pass(const EventPiece* before, const EventPiece& after, Matrix& dx) {
  const bool changes = before && before->active != after.active;
  const bool switches = before && before->event >= 0 && (changes || !after.impulses.empty() || !after.set.empty());
  Eigen::RowVectorXd dt = Eigen::RowVectorXd::Zero(dx.cols());
  if (switches) {
    dt = moved_times(*before, dx);
    dx += rate_at(*before, end_of(*before)) * dt;
  }
  for (const Index j : after.set) dx.row(j).setZero();
  jump(before, after, dt, dx);
  if (!switches) return;
  dx -= rate_at(after, 0) * dt;
}

// Of the switch that ends the piece: dt for each column. Where the component only touches zero it has none.
Eigen::RowVectorXd FlowDerivative::moved_times(const EventPiece& before, const Matrix& dx) {
  constexpr double grazing = 1e-12;
  const SwitchedMode& mode = *mode_of(before, before.active);
  const Index i = before.event;
  const bool active = std::binary_search(before.active.begin(), before.active.end(), i);
  const Eigen::RowVectorXd row = (active ? mode.y : mode.w).x.row(i);
  const Vector c = values_of(before, i, active);
  const Vector slopes = Collocation::get().derivative * c;
  const double slope = legendre(end_of(before)).dot(slopes);
  if (!(std::abs(slope) > grazing * c.cwiseAbs().sum())) return Eigen::RowVectorXd::Zero(dx.cols());
  return row * dx * (-before.length / slope);
}

// Of y_i, or else of w_i: Legendre coefficients.
Vector FlowDerivative::values_of(const EventPiece& p, Index i, bool of_y) {
  if (of_y) return p.y.col(i);
  const Regime& regime = system_of(p).regime;
  return p.x * regime.system.N.row(i).transpose() + p.y * regime.system.M.row(i).transpose() +
         regime.sources.sample(p.begin, p.length).g.col(i);
}

// f and g with their derivatives at a place of a piece; x is that of the piece.
JetValues FlowDerivative::values_at(const EventPiece& p, double at) {
  const Collocation& c = Collocation::get();
  const EventSources::Polynomials given = system_of(p).regime.sources.sample(p.begin, p.length);
  const Vector e0 = legendre(at), e1 = c.derivative.transpose() * e0 / p.length,
               e2 = c.derivative.transpose() * e1 / p.length;
  return {p.x.transpose() * e0,     given.f.transpose() * e0, given.f.transpose() * e1,
          given.g.transpose() * e0, given.g.transpose() * e1, given.g.transpose() * e2};
}

// The derivative of the impulses with which a piece begins, at a time that changes by dt. An impulse is that of the
// constraints of its mode, which hold along the motion in it, and of the rebound of the motion before.
void FlowDerivative::jump(const EventPiece* before, const EventPiece& after, const Eigen::RowVectorXd& dt, Matrix& dx) {
  if (after.impulses.empty()) return;
  JetValues u = values_at(after, 0);
  std::optional<JetValues> rates;  // of f and g before the impact
  if (before) {
    rates = values_at(*before, end_of(*before));
    rates->x.setZero();
    rates->f = rates->df, rates->g = rates->dg, rates->dg = rates->ddg;
  }
  const SystemMatrices& system = system_of(after).regime.system;
  for (const EventImpulse& impulse : after.impulses) u.x -= system.B * impulse.p;
  for (const EventImpulse& impulse : after.impulses) {
    u.x += system.B * impulse.p;
    const SwitchedMode* mode = mode_of(after, impulse.active);
    if (!mode) continue;
    const Vector rate = system.A * u.x + system.B * evaluate(mode->y, u) + u.f;
    Matrix off = mode->constraints.x * (dx - rate * dt);
    if (impulse.e.size() > 0) {
      const Jet back = rebound(system, *mode, impulse.e);
      off += back.x * dx;
      if (rates) off += evaluate(back, *rates) * dt;
    }
    dx += system.B * (mode->impulse * off);
  }
}

}  // namespace bromwich
