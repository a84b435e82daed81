// The passes of a SwitchedTape: a change forward in time, weights backward.

#include "core/base/error.hpp"
#include "derivatives/switched_tape.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index tape_degree = Collocation::degree;

// The values that a row is applied to get jet^T v.
JetValues back(const Jet& c, const Vector& v) {
  return {c.x.transpose() * v, c.f.transpose() * v,  c.df.transpose() * v,
          c.g.transpose() * v, c.dg.transpose() * v, c.ddg.transpose() * v};
}

}  // namespace

// f~ and g~ as polynomials on the piece.
SwitchedTape::Sources SwitchedTape::changed(const Part& part, const DataChange& c) const {
  const Piece& p = piece_of(part);
  Sources s = no_sources();
  if (c.A.size() > 0) s.f += p.x * c.A.transpose();
  if (c.B.size() > 0) s.f += p.y * c.B.transpose();
  if (c.E.size() > 0) s.f += p.rate * c.E.transpose();
  if (c.N.size() > 0) s.g += p.x * c.N.transpose();
  if (c.M.size() > 0) s.g += p.y * c.M.transpose();
  if (c.f.size() > 0) s.f.topRows(2) += table_part(c.f, part);
  if (c.g.size() > 0) s.g.topRows(2) += table_part(c.g, part);
  if (!only_along_.empty()) add_terms(part, c, s);
  return s;
}

void SwitchedTape::add_terms(const Part& part, const DataChange& c, Sources& s) const {
  const Piece& p = piece_of(part);
  s.terms_of_f = Vector::Zero(m_), s.terms_of_g = Vector::Zero(n_);
  const auto add = [](Vector& to, const Matrix& change, const Matrix& of) {
    if (change.size() > 0) to += change.cwiseAbs() * of.cwiseAbs().colwise().sum().transpose();
  };
  add(s.terms_of_f, c.A, p.x), add(s.terms_of_f, c.B, p.y), add(s.terms_of_f, c.E, p.rate);
  add(s.terms_of_g, c.N, p.x), add(s.terms_of_g, c.M, p.y);
  for (const Index j : {part.interval, part.interval + 1}) {
    if (c.f.size() > 0) s.terms_of_f += c.f.row(j).cwiseAbs().transpose();
    if (c.g.size() > 0) s.terms_of_g += c.g.row(j).cwiseAbs().transpose();
  }
}

void SwitchedTape::add_changed(const Part& part, const Sources& bar, DataChange& to) const {
  const Piece& p = piece_of(part);
  to.A += bar.f.transpose() * p.x;
  to.B += bar.f.transpose() * p.y;
  to.E += bar.f.transpose() * p.rate;
  to.N += bar.g.transpose() * p.x;
  to.M += bar.g.transpose() * p.y;
  add_table_part(bar.f.topRows(2), part, to.f);
  add_table_part(bar.g.topRows(2), part, to.g);
}

// The first two coefficients, on the piece, of the line through two rows of a table.
Matrix SwitchedTape::table_part(const RowMatrix& table, const Part& part) const {
  const Piece& p = piece_of(part);
  const Index j = part.interval;
  const double step = t_[j + 1] - t_[j], a = (p.begin + 0.5 * p.length - t_[j]) / step;
  Matrix c(2, table.cols());
  c.row(0) = (1 - a) * table.row(j) + a * table.row(j + 1);
  c.row(1) = (0.5 * p.length / step) * (table.row(j + 1) - table.row(j));
  return c;
}

void SwitchedTape::add_table_part(const Matrix& bar, const Part& part, RowMatrix& to) const {
  const Piece& p = piece_of(part);
  const Index j = part.interval;
  const double step = t_[j + 1] - t_[j], a = (p.begin + 0.5 * p.length - t_[j]) / step;
  const double slope = 0.5 * p.length / step;
  to.row(j) += (1 - a) * bar.row(0) - slope * bar.row(1);
  to.row(j + 1) += a * bar.row(0) + slope * bar.row(1);
}

// Coefficients on the part of what drives (x, integral of y): (tape_degree+1) x (m+n).
Matrix SwitchedTape::inputs(const Part& part, const Sources& s) const {
  const Piece& p = piece_of(part);
  const Jet& y = p.mode->rows.y;
  const Matrix D = Collocation::get().derivative / p.length;
  Matrix of_y = s.f * y.f.transpose() + s.g * y.g.transpose();
  if (p.mode->rows.uses_df) of_y += D * s.f * y.df.transpose();
  if (p.mode->rows.uses_dg) of_y += D * s.g * y.dg.transpose();
  if (p.mode->rows.uses_ddg) of_y += D * (D * s.g) * y.ddg.transpose();
  Matrix all(tape_degree + 1, m_ + n_);
  all << s.f + of_y * p.mode->system().B.transpose(), of_y;
  return part.inputs * all;
}

void SwitchedTape::add_inputs(const Part& part, const Matrix& bar, Sources& to) const {
  const Piece& p = piece_of(part);
  const Jet& y = p.mode->rows.y;
  const Matrix D = Collocation::get().derivative / p.length, all = part.inputs.transpose() * bar;
  const Matrix of_f = all.leftCols(m_), of_y = of_f * p.mode->system().B + all.rightCols(n_);
  to.f += of_f + of_y * y.f;
  to.g += of_y * y.g;
  if (p.mode->rows.uses_df) to.f += D.transpose() * of_y * y.df;
  if (p.mode->rows.uses_dg) to.g += D.transpose() * of_y * y.dg;
  if (p.mode->rows.uses_ddg) to.g += D.transpose() * (D.transpose() * of_y) * y.ddg;
}

// What a change adds to the state within a part, by absolute values.
void SwitchedTape::add_terms(const Part& part, const Sources& s, State& z) const {
  const Piece& p = piece_of(part);
  const double length = part.width * p.length;
  for (const double share : {0.0, 1.0}) {
    JetValues u = switched::sizes_of(values_of(s, p, part.from + share * part.width));
    u.x = z.x.cwiseAbs();
    const SystemMatrices& system = p.mode->system();
    const Vector rate = system.A.cwiseAbs() * u.x + u.f + system.B.cwiseAbs() * terms(p.mode->rows.y, u);
    z.largest = z.largest.cwiseMax(u.x + length * rate);
  }
}

void SwitchedTape::advance(const Part& part, const Sources& s, State& z) const {
  const PartMaps& maps = *part.maps;
  Vector both(m_ + n_);
  both << z.x, z.integral;
  const Matrix u = inputs(part, s);
  Vector next = maps.decay * both;
  for (Index k = 0; k <= tape_degree; ++k) next += maps.inputs[std::size_t(k)] * u.row(k).transpose();
  if (z.largest.size() > 0) add_terms(part, s, z);
  z.x = next.head(m_);
  z.integral = next.tail(n_);
}

void SwitchedTape::advance_back(const Part& part, Sources& of, State& bar) const {
  const PartMaps& maps = *part.maps;
  Vector both(m_ + n_);
  both << bar.x, bar.integral;
  Matrix u(tape_degree + 1, m_ + n_);
  for (Index k = 0; k <= tape_degree; ++k) u.row(k) = both.transpose() * maps.inputs[std::size_t(k)];
  add_inputs(part, u, of);
  const Vector before = maps.decay.transpose() * both;
  bar.x = before.head(m_);
  bar.integral = before.tail(n_);
}

// Onto the constraints of the mode: a kink of g moves the state of a contact.
void SwitchedTape::project(const Part& part, const Sources& s, State& z) const {
  const SwitchedMode& mode = piece_of(part).mode->rows;
  if (mode.constraints.x.rows() == 0) return;
  JetValues u = values_of(s, piece_of(part), part.from);
  u.x = z.x;
  const Vector p = mode.impulse * evaluate(mode.constraints, u);
  z.x += piece_of(part).mode->system().B * p;
  z.integral += p;
}

void SwitchedTape::project_back(const Part& part, Sources& of, State& bar) const {
  const SwitchedMode& mode = piece_of(part).mode->rows;
  if (mode.constraints.x.rows() == 0) return;
  const Vector p = piece_of(part).mode->system().B.transpose() * bar.x + bar.integral;
  const JetValues u = back(mode.constraints, mode.impulse.transpose() * p);
  bar.x += u.x;
  add_values(u, piece_of(part), part.from, of);
}

void SwitchedTape::pass(const Switch& s, const Part* before, const Sources& of_before, const Part& after,
                        const Sources& of_after, const DataChange& c, State& z, double moved) const {
  double dt = moved;
  Vector terms_of_x = terms_of(z);
  if (s.moves) {
    JetValues u = values_of(of_before, piece_of(*before), before->from + before->width);
    u.x = z.x;
    dt = -evaluate(s.row, u)[0] / s.rate;
  }
  if (before) {
    terms_of_x += std::abs(dt) * (s.rate_before.cwiseAbs() + s.rate_after.cwiseAbs());
    if (z.zeros == Zeros::stay)
      check_conditions(s, true, piece_of(*before), before->from + before->width, of_before, z.x, terms_of_x, dt);
    z.x += dt * s.rate_before;
    z.integral += dt * s.y_before;
  }
  for (const Index j : s.set) z.x[j] = terms_of_x[j] = 0;
  for (const Impulse& p : s.impulses) {
    const Matrix& B = p.mode->system().B;
    JetValues left = before ? values_of(of_before, piece_of(*before), before->from + before->width)
                            : values_of(of_after, piece_of(after), after.from);
    left.x = z.x;
    Vector back = evaluate(p.rebound, left) + dt * p.rebound_rate;
    if (c.restitution.size() > 0) back += p.by_restitution * c.restitution;
    if (c.B.size() > 0) z.x += c.B * p.p;
    if (c.E.size() > 0) z.x += c.E * p.move;
    const SwitchedMode& mode = p.mode->rows;
    const Vector by_M = change_by_M(p, c);
    z.x += B * by_M;
    JetValues u = values_of(of_after, piece_of(after), after.from);
    u.x = z.x - dt * p.rate;
    const Vector q = mode.impulse * (evaluate(mode.constraints, u) + back) + by_M;
    z.x += B * (q - by_M);
    z.integral += q;
    terms_of_x += B.cwiseAbs() * q.cwiseAbs();
  }
  if (before) {
    z.x -= dt * s.rate_after;
    z.integral -= dt * s.y_after;
  }
  if (z.largest.size() > 0) z.largest = z.largest.cwiseMax(terms_of_x);
  if (z.zeros == Zeros::stay) check_conditions(s, false, piece_of(after), after.from, of_after, z.x, terms_of_x, dt);
}

// What M_SS p = 0 asks of p where M changes.
Vector SwitchedTape::change_by_M(const Impulse& p, const DataChange& c) {
  Vector by = Vector::Zero(p.p.size());
  if (c.M.size() == 0) return by;
  const std::vector<Index>& S = p.mode->rows.active;
  const Matrix M = p.mode->system().M(S, S);
  const Vector off = (c.M * p.p)(S), found = Eigen::CompleteOrthogonalDecomposition<Matrix>(M).solve(Vector(-off));
  by(S) = found;
  return by;
}

// The changes of the times at which parts begin.
std::vector<double> SwitchedTape::moved_parts(const std::vector<MovingJump>& jumps) const {
  std::vector<double> moved(parts_.size(), 0);
  for (const MovingJump& jump : jumps) {
    const auto begins = [&](const Part& p) {
      const Piece& piece = piece_of(p);
      return std::abs(piece.begin + p.from * piece.length - jump.t) <= 1e-9 * T_ && p.from == 0;
    };
    const auto found = std::find_if(parts_.begin(), parts_.end(), begins);
    if (found == parts_.end() || found == parts_.begin())
      throw Error("derivative", "no piece of the solution begins where a source jumps", "state the breakpoint");
    moved[std::size_t(found - parts_.begin())] += jump.change;
  }
  return moved;
}

void SwitchedTape::pass_back(const Switch& s, const Part* before, Sources& of_before, const Part& after,
                             Sources& of_after, DataChange& to, State& bar) const {
  double dt = 0;
  if (s.moves) dt -= s.rate_after.dot(bar.x) + s.y_after.dot(bar.integral);
  for (auto p = s.impulses.rbegin(); p != s.impulses.rend(); ++p) {
    const SwitchedMode& mode = p->mode->rows;
    const Vector q = p->mode->system().B.transpose() * bar.x + bar.integral;
    const Vector off = mode.impulse.transpose() * q;
    const JetValues u = back(mode.constraints, off);
    bar.x += u.x;
    if (s.moves) dt -= p->rate.dot(u.x);
    add_values(u, piece_of(after), after.from, of_after);
    to.B += bar.x * p->p.transpose();
    to.E += bar.x * p->move.transpose();
    to.restitution += p->by_restitution.transpose() * off;
    const JetValues r = back(p->rebound, off);
    bar.x += r.x;
    dt += p->rebound_rate.dot(off);
    if (before)
      add_values(r, piece_of(*before), before->from + before->width, of_before);
    else
      add_values(r, piece_of(after), after.from, of_after);
  }
  for (const Index j : s.set) bar.x[j] = 0;
  if (!s.moves) return;
  dt += s.rate_before.dot(bar.x) + s.y_before.dot(bar.integral);
  const JetValues u = back(s.row, Vector{{-dt / s.rate}});
  bar.x += u.x;
  add_values(u, piece_of(*before), before->from + before->width, of_before);
}

void SwitchedTape::write(Index row, const Part& part, double at, const State& z, const Sources& s,
                         SolutionChange& to) const {
  JetValues u = values_of(s, piece_of(part), at);
  u.x = z.x;
  const Vector y = evaluate(piece_of(part).mode->rows.y, u);
  to.y.row(row) = y.transpose();
  to.x.row(row) = z.x.transpose();
  const SystemMatrices& system = piece_of(part).mode->system();
  to.w.row(row) = (system.N * z.x + system.M * y + u.g).transpose();
  to.integral.row(row) = z.integral.transpose();
}

void SwitchedTape::read(Index row, const Part& part, double at, const SolutionChange& from, State& bar,
                        Sources& of) const {
  Vector of_y = Vector::Zero(n_), of_w = of_y;
  if (from.y.size() > 0) of_y += from.y.row(row).transpose();
  if (from.w.size() > 0) of_w += from.w.row(row).transpose();
  const SystemMatrices& system = piece_of(part).mode->system();
  JetValues u = back(piece_of(part).mode->rows.y, of_y + system.M.transpose() * of_w);
  u.g += of_w;
  bar.x += u.x + system.N.transpose() * of_w;
  if (from.x.size() > 0) bar.x += from.x.row(row).transpose();
  if (from.integral.size() > 0) bar.integral += from.integral.row(row).transpose();
  add_values(u, piece_of(part), at, of);
}

SolutionChange SwitchedTape::jvp(const ChangeInModes& change_in, const Vector& x0, const std::vector<MovingJump>& jumps,
                                 Zeros zeros) const {
  check_structure(change_in);
  const std::vector<double> moved = moved_parts(jumps);
  const Index rows = t_.size();
  SolutionChange out{RowMatrix::Zero(rows, n_), RowMatrix::Zero(rows, m_), RowMatrix::Zero(rows, n_),
                     RowMatrix::Zero(rows, n_)};
  State z{x0.size() > 0 ? x0 : Vector::Zero(m_), Vector::Zero(n_), {}, zeros};
  if (!only_along_.empty()) z.largest = z.x.cwiseAbs();
  const Part* before = nullptr;
  Sources last = no_sources();
  for (const Part& part : parts_) {
    const DataChange& c = change_in(piece_of(part).mode->regime->modes);
    const Sources s = changed(part, c);
    const double by = moved[std::size_t(&part - parts_.data())];
    if (part.change >= 0) {
      pass(switches_[std::size_t(part.change)], before, last, part, s, c, z, by);
    } else if (by != 0) {  // the same set on both sides
      const Piece &left = piece_of(*before), &right = piece_of(part);
      const Vector end = legendre(before->from + before->width), begin = legendre(part.from);
      z.x += by * (left.rate.transpose() * end - right.rate.transpose() * begin);
      z.integral += by * (left.y.transpose() * end - right.y.transpose() * begin);
    }
    project(part, s, z);
    for (Index row = part.first_row; row <= part.row; ++row) write(row, part, part.from, z, s, out);
    if (zeros == Zeros::stay) check_rest(part, 0, s, z);
    advance(part, s, z);
    if (zeros == Zeros::stay) check_rest(part, 1, s, z);
    before = &part;
    last = s;
  }
  write(rows - 1, parts_.back(), parts_.back().from + parts_.back().width, z, last, out);
  return out;
}

DataChange SwitchedTape::vjp(const SolutionChange& of) const {
  const Index rows = t_.size();
  DataChange to{Vector(),
                RowMatrix::Zero(rows, m_),
                RowMatrix::Zero(rows, n_),
                Matrix::Zero(m_, m_),
                Matrix::Zero(m_, n_),
                Matrix::Zero(n_, m_),
                Matrix::Zero(n_, n_),
                Matrix::Zero(m_, m_)};
  to.restitution = Vector::Zero(n_);
  State bar{Vector::Zero(m_), Vector::Zero(n_), {}};
  Sources sources = no_sources();
  read(rows - 1, parts_.back(), parts_.back().from + parts_.back().width, of, bar, sources);
  for (std::size_t k = parts_.size(); k-- > 0;) {
    const Part& part = parts_[k];
    Sources before = no_sources();
    advance_back(part, sources, bar);
    for (Index row = part.first_row; row <= part.row; ++row) read(row, part, part.from, of, bar, sources);
    project_back(part, sources, bar);
    if (part.change >= 0)
      pass_back(switches_[std::size_t(part.change)], k > 0 ? &parts_[k - 1] : nullptr, before, part, sources, to, bar);
    add_changed(part, sources, to);
    sources = std::move(before);
  }
  to.x0 = bar.x;
  leave_out_conditioned(to);
  return to;
}

void SwitchedTape::leave_out_conditioned(DataChange& gradient) const {
  if (conditioned_.start) gradient.x0.resize(0);
  if (conditioned_.rates) {
    gradient.f.resize(0, 0);
    for (Matrix* member : {&gradient.A, &gradient.B, &gradient.E}) member->resize(0, 0);
  }
  if (conditioned_.rows) {
    gradient.g.resize(0, 0);
    gradient.N.resize(0, 0);
  }
  if (conditioned_.rows || !without_M_.empty()) gradient.M.resize(0, 0);
  if (!inelastic_.empty()) gradient.restitution.resize(0);
  const auto ambiguous = [](const auto& of_set) { return of_set.second.right.cols() + of_set.second.left.cols() > 0; };
  if (std::any_of(ambiguities_.begin(), ambiguities_.end(), ambiguous))
    for (Matrix* member : {&gradient.B, &gradient.N, &gradient.M}) member->resize(0, 0);
}

}  // namespace bromwich
