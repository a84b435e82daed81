#include "core/march/impact_steps.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

Vector means(const Matrix& c, double from, double to) {
  return c.col(0) + (from + to) / 2 * c.col(1) + (from * from + from * to + to * to) / 3 * c.col(2);
}

}  // namespace

ImpactSteps::ImpactSteps(const ImpactRows& rows, double h, const Vector& x0)
    : rows_(rows),
      flow_(rows.A),
      h_(h),
      N_(rows.N),
      size_of_N_(rows.N.cwiseAbs()),
      size_of_NA_(rows.NA.cwiseAbs()),
      response_(flow_, rows.B, rows.speeds, h),
      x_(x0),
      y_(Vector::Zero(rows.constraints())),
      shown_(y_),
      integral_(y_),
      closed_(rows.kind.size(), 0) {
  if (HeldImpacts::serves(rows)) held_impacts_.emplace(rows, flow_, h);
}

ImpactSteps::Look ImpactSteps::look(const SmoothSources& now, double s, const Vector& x, const Vector& y) const {
  const Vector f = values(now.f, s), g = values(now.g, s), dg = slopes(now.g, s);
  const Vector x_size = x.cwiseAbs(), f_size = f.cwiseAbs();
  return {rows_.N * x + g, rows_.NA * x + rows_.N * f + rows_.NB * y + dg, size_of_N_ * x_size + g.cwiseAbs(),
          size_of_NA_ * x_size + size_of_N_ * f_size + dg.cwiseAbs()};
}

bool ImpactSteps::start(const SmoothSources& first) {
  const Look at = look(first, 0, x_, y_);
  const Vector zero = rows_.touching(x_, values(first.g, 0));
  std::vector<Index> gaps;
  for (Index i = 0; i < y_.size(); ++i) {
    if (!rows_.is(i, Kind::gap) || at.w[i] > zero[i]) continue;
    closed_[std::size_t(i)] = at.slope[i] <= no_speed * at.size_of_slope[i];
    if (closed_[std::size_t(i)]) gaps.push_back(i);
  }
  begin_step();
  return strike(first, 0, gaps);
}

bool ImpactSteps::pass(const SmoothSources& now) {
  if (now.breaks) {  // a body that stops or turns strikes what lies on it
    const Look at = look(now, 0, x_, y_);
    std::vector<Index> struck;
    for (Index i = 0; i < y_.size(); ++i)
      if (closed_[std::size_t(i)] && at.slope[i] < -kink * std::abs(now.g(i, 1))) struck.push_back(i);
    if (!struck.empty() && !strike(now, 0, struck)) return false;
  }
  if (goes_on_as_before(now)) return true;
  Part part;
  double from = 0;
  for (Index count = 0; from < now.length - same_time * h_; ++count) {
    const double d = now.length - from;
    rests_ = false;
    if (count == most_parts * y_.size() || !take(now, from, d, part)) return false;
    Event event = first_event(now, from, d, part);
    if (event.rests && !cones_among(part.rows).empty()) {
      rests_ = true;
      if (!take(now, from, d, part)) return false;
      event = first_event(now, from, d, part);
    }
    if (event.at <= same_time * h_) {
      put_back(now, from, event.gaps);
      if (!strike(now, from, event.gaps)) return false;
      continue;
    }
    double length = std::min(event.at, d);
    if (event.at < d - same_time * h_ && !take(now, from, length, part)) return false;
    while (length > shortest_turn * h_ && turns_far(now, from, length, part)) {
      length /= 2, event.gaps.clear();
      if (!take(now, from, length, part)) return false;
    }
    if (first_.size() == 0) first_ = y_at_begin(now, part);
    const Vector slid = slips(now, from, x_);
    from += length;
    x_ = part.x, y_ = part.y, shown_ = part.shown;
    for (Index i = 0; i < y_.size(); ++i)
      integral_[i] += rows_.is_force[std::size_t(i)] ? part.z[i] : length * (slid[i] + y_[i]) / 2;
    open(now, from, part.z);
    put_back(now, from, event.gaps);
    if (!event.gaps.empty() && !strike(now, from, event.gaps)) return false;
  }
  return true;
}

// A whole step with the contacts and forces of the last one, where these were those of the one before.
bool ImpactSteps::goes_on_as_before(const SmoothSources& now) {
  if (!held_impacts_ || first_.size() == 0 || std::abs(now.length - h_) > 1e-12 * h_) return false;
  if (!held_impacts_->is_held(closed_, y_)) {
    std::vector<char> active(closed_.size());
    for (Index i = 0; i < y_.size(); ++i) active[std::size_t(i)] = y_[i] > 0;
    const bool settled = closed_ == closed_before_ && active == active_before_;
    closed_before_ = closed_, active_before_ = std::move(active);
    if (!settled) return false;
    const Vector bounds = means(now.g, 0, h_);
    const std::vector<Index> rows = rows_.acting(closed_, &bounds);
    std::vector<Index> gaps;
    for (Index i = 0; i < y_.size(); ++i)
      if (closed_[std::size_t(i)]) gaps.push_back(i);
    if (!gaps.empty()) prepare_to_put_back(gaps);
    Matrix back(x_.size(), Index(gaps.size()));
    for (std::size_t k = 0; k < gaps.size(); ++k) back.col(Index(k)) = rows_.onto.col(gaps[k]);
    held_impacts_->hold(closed_, rows, matrix(h_, rows), y_, gaps, gaps.empty() ? back : Matrix(back * onto_held_));
  }
  if (!held_impacts_->step(now, x_, y_, integral_, residual_)) return false;
  shown_ = y_;
  ++report_.count.solved, ++report_.count.newton;
  return true;
}

// M + speeds D of these rows.
Matrix ImpactSteps::matrix(double d, const std::vector<Index>& rows) const {
  Matrix W = rows_.M(rows, rows);
  std::vector<Index> place(std::size_t(y_.size()), -1);
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (!rows_.is(rows[r], Kind::room)) place[std::size_t(rows[r])] = Index(r);
  for (std::size_t c = 0; c < rows.size(); ++c) {
    if (rows_.is(rows[c], Kind::spring)) W(Index(c), Index(c)) /= d;
    if (!rows_.is_force[std::size_t(rows[c])]) continue;
    for (const Index i : response_.rows(rows[c]))
      if (const Index r = place[std::size_t(i)]; r >= 0) W(r, Index(c)) += response_.at(d, i, rows[c]);
  }
  return W;
}

ImpactProblem ImpactSteps::problem(double d, const std::vector<Index>& rows) const {
  return {matrix(d, rows), cones_among(rows)};
}

// The part from x_ that begins at `from`, with the contacts that are closed.
bool ImpactSteps::take(const SmoothSources& now, double from, double d, Part& part) {
  const double to = from + d;
  const Index n = y_.size();
  const Vector bounds = means(now.g, from, to);
  part.rows = rows_.acting(closed_, &bounds);
  Matrix free = x_;
  flow_.advance(d, from_there(now.f, from), free);
  part.x = free;
  part.z = part.y = part.shown = Vector::Zero(n);
  if (!part.rows.empty()) {
    const Look end = look(now, to, part.x, part.y);
    Vector q(Index(part.rows.size()));
    for (Index k = 0; k < q.size(); ++k) {
      const Index i = part.rows[std::size_t(k)];
      q[k] = rows_.is(i, Kind::gap) ? end.slope[i] : rows_.is(i, Kind::room) ? d * bounds[i] : end.w[i];
      if (rows_.is(i, Kind::spring)) q[k] = (q[k] + N_.row(i).dot(x_) + value(now.g, i, from)) / 2;
    }
    ImpactSolution found;
    if (!solve_part(d, part.rows, q, slides(now, from, part.rows), found)) return false;
    for (Index k = 0; k < q.size(); ++k) {
      const Index i = part.rows[std::size_t(k)];
      const double length = rows_.is_force[std::size_t(i)] ? d : 1;
      part.z[i] = found.z[k], part.y[i] = found.z[k] / length, part.shown[i] = found.at_end[k] / length;
    }
    if (!part.z.isZero(0)) {
      QuadraticColumns input = from_there(now.f, from);
      input[0] += rows_.B * part.y;
      free = x_;
      flow_.advance(d, input, free);
      part.x = free;
    }
  }
  const Vector idle = slips(now, to, part.x);
  for (const ImpactRows::Friction& f : rows_.friction)
    if (!f.circle && !std::binary_search(part.rows.begin(), part.rows.end(), f.room))
      part.z[f.room] = part.y[f.room] = part.shown[f.room] = idle[f.room];
  show_given_bounds(now, to, part);
  return true;
}

bool ImpactSteps::solve_part(double d, const std::vector<Index>& rows, const Vector& q, const Matrix& slides,
                             ImpactSolution& found) {
  if (std::abs(d - h_) > 1e-12 * h_) {
    ImpactProblem once = problem(d, rows);
    once.start_from(y_(rows));
    return solve(once, q, slides, found);
  }
  if (!kept_ || rows != kept_rows_) {
    kept_.emplace(problem(h_, rows));
    kept_->start_from(y_(rows));
    kept_rows_ = rows;
  }
  return solve(*kept_, q, slides, found);
}

bool ImpactSteps::solve(ImpactProblem& problem, const Vector& q, const Matrix& slides, ImpactSolution& found) {
  found = problem.solve(q, slides);
  report_.count.newton += found.newton;
  report_.count.fallbacks += found.fallback;
  ++(found.solved ? report_.count.solved : report_.count.unsolved);
  report_.finite = report_.finite && q.allFinite();
  residual_ = std::max(residual_, found.residual);
  return found.solved;
}

// y of friction that are no forces: the speeds that its rows need.
Vector ImpactSteps::slips(const SmoothSources& now, double s, const Vector& x) const {
  Vector y = Vector::Zero(y_.size());
  for (const ImpactRows::Friction& f : rows_.friction) {
    if (f.circle) continue;
    for (const Index i : f.forces)
      if (const double by = rows_.M(i, f.room); by > 0)
        y[f.room] = std::max(y[f.room], -(N_.row(i).dot(x) + value(now.g, i, s)) / by);
  }
  return y;
}

// Forces of the first part, and what the speeds at its begin make of the others.
Vector ImpactSteps::y_at_begin(const SmoothSources& now, const Part& part) const {
  Vector y = part.y;
  const Vector slid = slips(now, 0, x_);
  for (const ImpactRows::Friction& f : rows_.friction)
    if (!f.circle) y[f.room] = slid[f.room];
  const std::vector<ImpactCone> cones = cones_among(part.rows);
  const Matrix along = slides(now, 0, part.rows);
  for (Index k = 0; k < along.cols(); ++k) {
    const Index first = part.rows[std::size_t(cones[std::size_t(k)].first + 1)] - 1;
    if (!along.col(k).isZero(0)) y.segment(first + 1, 2) = -cones[std::size_t(k)].mu * y[first] * along.col(k);
  }
  return y;
}

// Contacts close where cubics through the gaps and their slopes at both ends of the part fall below 0.
ImpactSteps::Event ImpactSteps::first_event(const SmoothSources& now, double from, double d, const Part& part) {
  const Look begin = look(now, from, x_, part.y), end = look(now, from + d, part.x, part.y);
  Event event;
  Vector at = Vector::Constant(y_.size(), INFINITY);
  for (Index i = 0; i < y_.size(); ++i) {
    if (!rows_.is(i, Kind::gap) || closed_[std::size_t(i)]) continue;
    const double zero = 64 * epsilon * std::max(begin.size[i], end.size[i]);
    at[i] = first_fall({std::max(begin.w[i], 0.0), begin.slope[i], end.w[i], end.slope[i]}, d, zero);
    event.at = std::min(event.at, at[i]);
  }
  const double turn = first_turn(now, from, d, begin, end, part);
  event.rests = turn == 0;
  if (turn > 0) event.at = std::min(event.at, turn);
  for (Index i = 0; i < y_.size(); ++i)
    if (at[i] <= event.at + same_time * h_ && std::isfinite(at[i])) event.gaps.push_back(i);
  return event;
}

// -w'' of gaps, with the forces of the last part but those of the contact itself.
Vector ImpactSteps::falling(const SmoothSources& now, double s) const {
  const Vector rates = rows_.A * x_ + rows_.B * y_ + values(now.f, s);
  Vector falls = -(rows_.NA * rates + rows_.N * slopes(now.f, s) + 2 * now.g.col(2));
  for (Index i = 0; i < y_.size(); ++i)
    if (rows_.is(i, Kind::gap) && y_[i] > 0) falls[i] += rows_.impulses(i, i) * y_[i];
  for (const ImpactRows::Friction& f : rows_.friction)
    for (const Index i : f.normals)
      for (const Index j : f.forces) falls[i] += rows_.impulses(i, j) * y_[j];
  return falls;
}

// Whether a contact that parts with this speed is back soon.
bool ImpactSteps::is_brief(double speed, double falls) const { return 2 * speed < shortest_flight * h_ * falls; }

// Impulses where these gaps have closed.
bool ImpactSteps::strike(const SmoothSources& now, double s, const std::vector<Index>& gaps) {
  const Look before = look(now, s, x_, y_);
  const Vector zero = no_speed * before.size_of_slope;
  std::vector<Index> struck;
  for (const Index i : gaps) {
    closed_[std::size_t(i)] = 1;
    if (before.slope[i] < -zero[i]) struck.push_back(i);
  }
  if (struck.empty()) return true;
  const std::vector<Index> rows = rows_.reached(rows_.acting(closed_, nullptr), struck);
  const Vector falls = falling(now, s);
  Vector q(Index(rows.size())), bounce = Vector::Zero(y_.size());
  for (Index k = 0; k < q.size(); ++k) {
    const Index i = rows[std::size_t(k)];
    if (rows_.is(i, Kind::gap)) {
      const double rebound = before.slope[i] < -zero[i] ? -rows_.e[i] * before.slope[i] : 0;
      if (!is_brief(rebound, falls[i])) bounce[i] = rebound;
      q[k] = before.slope[i] - bounce[i];
    } else {
      q[k] = rows_.is(i, Kind::speed) ? before.w[i] : 0;
    }
  }
  ImpactProblem impulses(rows_.impulses(rows, rows), cones_among(rows));
  ImpactSolution found;
  if (!solve(impulses, q, {}, found)) return false;
  Vector p = Vector::Zero(y_.size());
  for (Index k = 0; k < q.size(); ++k)
    if (const Index i = rows[std::size_t(k)]; rows_.is_force[std::size_t(i)]) p[i] = found.z[k];
  const Vector jump = rows_.B * p;
  x_ += jump;
  if (!p.isZero(0)) impacts_.push_back({now.begin + s, p, jump});
  integral_ += p;
  for (Index i = 0; i < y_.size(); ++i)
    if (p[i] > 0 && bounce[i] > zero[i]) closed_[std::size_t(i)] = 0;
  open(now, s, p);
  return true;
}

// Contacts without a force that part for long enough are open.
void ImpactSteps::open(const SmoothSources& now, double s, const Vector& z) {
  const Look at = look(now, s, x_, y_);
  const Vector falls = falling(now, s);
  for (Index i = 0; i < y_.size(); ++i) {
    const double speed = at.slope[i];
    if (closed_[std::size_t(i)] && !(z[i] > 0) && speed > no_speed * at.size_of_slope[i] && !is_brief(speed, falls[i]))
      closed_[std::size_t(i)] = 0;
  }
}

// Positions onto the gaps that are closed, these, and what has come below 0.
void ImpactSteps::put_back(const SmoothSources& now, double s, const std::vector<Index>& more) {
  std::vector<Index> held;
  Vector off = Vector::Zero(y_.size());
  for (Index i = 0; i < y_.size(); ++i) {
    if (!rows_.is(i, Kind::gap)) continue;
    off[i] = N_.row(i).dot(x_) + value(now.g, i, s);
    if (closed_[std::size_t(i)] || off[i] < 0 || std::binary_search(more.begin(), more.end(), i)) held.push_back(i);
  }
  if (held.empty()) return;
  prepare_to_put_back(held);
  Vector by = Vector::Zero(y_.size());
  by(held) = onto_held_ * off(held);
  x_ -= rows_.onto * by;
}

void ImpactSteps::prepare_to_put_back(const std::vector<Index>& held) {
  if (held == held_) return;
  held_ = held;
  Matrix seen(Index(held.size()), Index(held.size()));
  for (std::size_t k = 0; k < held.size(); ++k) seen.col(Index(k)) = Vector(rows_.N * rows_.onto.col(held[k]))(held);
  onto_held_ = seen.completeOrthogonalDecomposition().pseudoInverse();
}

}  // namespace bromwich
