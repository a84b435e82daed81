#include "core/solve/event_rows.hpp"

#include "core/kernel/discretise.hpp"
#include "core/lcp/active_set.hpp"
#include "core/result/slack.hpp"
#include "core/scene/memory_rows.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

std::vector<Index> rows_at_breakpoints(const Scene& scene, const Vector& t) {
  const double apart = 1024 * epsilon * scene.T;
  std::vector<Index> rows;
  for (Index j = 1; j < t.size(); ++j) {
    const auto next = std::lower_bound(scene.breakpoints.begin(), scene.breakpoints.end(), t[j] - apart);
    if (next != scene.breakpoints.end() && *next <= t[j] + apart) rows.push_back(j);
  }
  return rows;
}

EventRows::EventRows(const Scene& scene, Backend& backend, Index J)
    : p_(discretise_points(scene, backend, J)),
      resolution_(256 * epsilon * scene.T),
      f_(scene.f, scene.f ? scene.sources() : 0, resolution_),
      g_(scene.g, scene.g ? scene.constraints() : 0, resolution_),
      start_(scene.memories.empty() ? solve_at_zero(p_, at_zero_) : Start::found),
      at_breakpoints_(rows_at_breakpoints(scene, p_.t)) {}

void EventRows::fill(const EventSolution& s, const std::vector<Index>& components, bool trace, Result& r) {
  const Index n = p_.scene.constraints(), J = p_.J;
  r.y = r.y_integral = RowMatrix::Constant(J + 1, n, NAN);
  states_ = RowMatrix::Constant(J + 1, p_.scene.states(), NAN);
  const bool located = !s.pieces.empty(), remembers = !p_.scene.memories.empty();
  const bool jumps = (start_ == Start::impulse || remembers) && located;  // modes that are left at once do not count
  r.y_integral.row(0).setZero();
  states_.row(0) = (jumps ? s.x(0, false) : p_.scene.x0).transpose();
  if (jumps || (located && !has_one_solution(p_.lcp_class)))  // M alone does not say what y is
    r.y.row(0) = s.y(0, false).cwiseMax(0).transpose();
  else if (!remembers)
    r.y.row(0) = at_zero_.y.row(0);
  const auto at_breakpoint = [this](Index j) {
    return std::binary_search(at_breakpoints_.begin(), at_breakpoints_.end(), j);
  };
  for (Index j = 1; j <= J && p_.t[j] <= s.until * (1 + 4 * epsilon) && !s.pieces.empty(); ++j) {
    const EventPiece& p = s.piece(p_.t[j], !at_breakpoint(j) || !takes_right(s, j));
    const double at = (std::clamp(p_.t[j], p.begin, p.end) - p.begin) / p.length;
    const LegendreValues values = legendre(at);
    states_.row(j).noalias() = values.transpose() * p.x;
    r.y.row(j).noalias() = values.transpose() * p.y;
    r.y_integral.row(j).noalias() = (p.length * legendre_integrals(at)).transpose() * p.y;
    r.y_integral.row(j) += p.integral.transpose();
    r.y.row(j) = r.y.row(j).cwiseMax(0);
  }
  if (!remembers) solve_at_own_values(p_.scene, p_.lcp_class, at_breakpoints_, states_, p_.t, r.y);
  r.modes = modes_of_rows();
  r.mode_changes = mode_changes(s);
  r.x = states_(Eigen::all, components);
  if (jumps) r.x.row(0) = p_.scene.x0(components).transpose();
  r.x_components = components;
  r.t = p_.t;
  r.steps = J;
  r.continuous = s.continuous;
  if (trace) r.trace = trace_of(r);
}

RowMatrix EventRows::modes_of_rows() const {
  RowMatrix modes(states_.rows(), Index(p_.scene.memories.size()));
  for (Index k = 0; k < modes.cols(); ++k) {
    const Index state = p_.scene.memories[std::size_t(k)].state;
    modes.col(k) = states_.col(state).unaryExpr([](double x) { return std::isfinite(x) ? std::round(x) : -1.0; });
  }
  return modes;
}

RowMatrix EventRows::trace_of(const Result& r) const {
  RowMatrix trace(states_.rows(), p_.scene.constraints());
  ScenesInModes scenes(p_.scene);
  for (Index j = 0; j < trace.rows(); ++j)
    trace.row(j) = observe(scenes.at_row(r.modes, j).dynamics, states_.row(j).transpose()).transpose();
  return trace;
}

double EventRows::residual(Result r) const {
  r.method = Method::events;
  r.trace = trace_of(r);
  // g on the side of each row.
  RowMatrix g_of_rows = slack(p_.scene, r) - r.trace;
  for (Index j = 0; j <= p_.J; ++j) g_of_rows.row(j) -= multiply(p_.scene.M, r.y.row(j).transpose()).transpose();
  const auto on_backend = [this](const RowMatrix& values) {
    auto array = p_.backend.array(values.rows(), values.cols());
    p_.backend.upload(values, *array);
    return array;
  };
  const auto g = on_backend(g_of_rows), v = on_backend(r.trace), y = on_backend(r.y);
  return march_residual(p_, Start::found, *g, *v, *y);
}

OtherSolution EventRows::other(const Result& r, bool at_corners) const {
  return has_one_solution(p_.lcp_class) || !p_.scene.memories.empty() ? OtherSolution{}
                                                                      : other_solution(p_, r, states_, at_corners);
}

// At a breakpoint: whether g, or f where g does not jump, has its value from the right there.
bool EventRows::takes_right(const EventSolution& s, Index j) const {
  constexpr double jump = 1e-9;  // of the values: less is the motion beside t
  if (j == p_.J) return false;
  const EventPiece& after = s.piece(p_.t[j], false);
  const double d = std::min(p_.h, after.end - after.begin);
  for (const OneSided* source : {&g_, &f_}) {
    if (source->width() == 0) continue;
    Vector own;
    source->value(p_.t[j], own);
    const Vector left = source->before(p_.t[j], d), right = source->after(p_.t[j], d);
    if ((left - right).cwiseAbs().maxCoeff() > jump * left.cwiseAbs().cwiseMax(right.cwiseAbs()).maxCoeff())
      return (own - right).cwiseAbs().maxCoeff() <= (own - left).cwiseAbs().maxCoeff();
  }
  return true;
}

void solve_at_own_values(const Scene& scene, LcpClass lcp_class, const std::vector<Index>& rows, const RowMatrix& x,
                         const Vector& t, RowMatrix& y) {
  if (rows.empty() || !scene.g || !has_one_solution(lcp_class)) return;
  ActiveSetLcp lcp(to_dense(scene.M), lcp_class);
  Vector found, g = Vector::Zero(scene.constraints());
  for (const Index j : rows) {
    if (!x.row(j).allFinite()) return;
    scene.g(t[j], g);
    if (lcp.solve(scene.dynamics->observe(x.row(j).transpose()) + g, found).solved) y.row(j) = found.transpose();
  }
}

}  // namespace bromwich
