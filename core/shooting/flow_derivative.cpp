#include "core/shooting/flow_derivative.hpp"

#include "core/events/collocation.hpp"
#include "core/events/switched_system.hpp"
#include "core/numerics/matrix_phi.hpp"

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

FlowDerivative::FlowDerivative(const Scene& scene) : system_(switched_system(scene)), sources_(scene), T_(scene.T) {}

const SwitchedMode* FlowDerivative::mode_of(const std::vector<Index>& active) {
  auto known = modes_.find(active);
  if (known == modes_.end()) known = modes_.emplace(active, make_switched_mode(system_, active)).first;
  return known->second ? &*known->second : nullptr;
}

const Matrix& FlowDerivative::propagator(const SwitchedMode* mode, double length) {
  const auto key = std::make_pair(mode, std::llround(std::ldexp(length / T_, 48)));
  if (const auto known = propagators_.find(key); known != propagators_.end()) return known->second;
  if (propagators_.size() >= most_propagators) propagators_.clear();
  return propagators_.emplace(key, matrix_phi(length * mode->A).exponential).first->second;
}

Matrix FlowDerivative::at_end(const EventSolution& s) {
  return carried(s, Matrix::Identity(system_.states(), system_.states()), nullptr);
}

FlowChange FlowDerivative::along(const EventSolution& s, const Vector& dx0) {
  FlowChange most{dx0.cwiseAbs(), Vector::Zero(system_.constraints())};
  carried(s, dx0, &most);
  return most;
}

Matrix FlowDerivative::carried(const EventSolution& s, Matrix dx, FlowChange* most) {
  const auto note = [&](const SwitchedMode& mode) {
    if (!most) return;
    most->x = most->x.cwiseMax(dx.col(0).cwiseAbs());
    most->y = most->y.cwiseMax((mode.y.x * dx.col(0)).cwiseAbs());
  };
  const EventPiece* before = nullptr;
  for (const EventPiece& p : s.pieces) {
    const SwitchedMode* mode = p.passed ? nullptr : mode_of(p.active);
    if (mode) {
      pass(before, p, dx);
      project(*mode, dx);
      note(*mode);
      dx = propagator(mode, p.end - p.begin) * dx;
      note(*mode);
    }
    before = p.passed ? nullptr : &p;
  }
  return dx;
}

void FlowDerivative::pass(const EventPiece* before, const EventPiece& after, Matrix& dx) {
  const bool changes = before && before->active != after.active;
  const bool switches = before && before->event >= 0 && (changes || !after.impulses.empty() || !after.resets.empty());
  Eigen::RowVectorXd dt = Eigen::RowVectorXd::Zero(dx.cols());
  if (switches) {
    dt = moved_times(*before, dx);
    dx += rate_at(*before, end_of(*before)) * dt;
  }
  for (const Index j : after.resets) dx.row(j).setZero();
  jump(before, after, dt, dx);
  if (!switches) return;
  dx -= rate_at(after, 0) * dt;
}

// Of the switch that ends the piece: dt for each column. Where the component only touches zero it has none.
Eigen::RowVectorXd FlowDerivative::moved_times(const EventPiece& before, const Matrix& dx) {
  constexpr double grazing = 1e-12;
  const SwitchedMode& mode = *mode_of(before.active);
  const Index i = before.event;
  const bool active = std::binary_search(before.active.begin(), before.active.end(), i);
  Eigen::RowVectorXd row = mode.y.x.row(i);
  Vector c = before.y.col(i);
  if (!active) {
    row = system_.N.row(i) + system_.M.row(i) * mode.y.x;
    c = before.x * system_.N.row(i).transpose() + before.y * system_.M.row(i).transpose() +
        sources_.sample(before.begin, before.length).g.col(i);
  }
  const Vector slopes = Collocation::get().derivative * c;
  const double slope = legendre(end_of(before)).dot(slopes);
  if (!(std::abs(slope) > grazing * c.cwiseAbs().sum())) return Eigen::RowVectorXd::Zero(dx.cols());
  return row * dx * (-before.length / slope);
}

// f and g with their derivatives at a place of a piece; x is that of the piece.
JetValues FlowDerivative::values_at(const EventPiece& p, double at) const {
  const Collocation& c = Collocation::get();
  const EventSources::Polynomials given = sources_.sample(p.begin, p.length);
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
  for (const EventImpulse& impulse : after.impulses) u.x -= system_.B * impulse.p;
  for (const EventImpulse& impulse : after.impulses) {
    u.x += system_.B * impulse.p;
    const SwitchedMode* mode = mode_of(impulse.active);
    if (!mode) continue;
    const Vector rate = system_.A * u.x + system_.B * evaluate(mode->y, u) + u.f;
    Matrix off = mode->constraints.x * (dx - rate * dt);
    if (impulse.e.size() > 0) {
      const Jet back = rebound(system_, *mode, impulse.e);
      off += back.x * dx;
      if (rates) off += evaluate(back, *rates) * dt;
    }
    dx += system_.B * (mode->impulse * off);
  }
}

void FlowDerivative::project(const SwitchedMode& mode, Matrix& dx) const {
  if (mode.constraints.x.rows() > 0) dx += system_.B * (mode.impulse * (mode.constraints.x * dx));
}

}  // namespace bromwich
