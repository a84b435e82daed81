#include "core/derivatives/switched_tape.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index tape_degree = Collocation::degree;
constexpr double same_time = 1e-12;         ///< of T
constexpr double at_switch = 1e-9;          ///< of T: switches and times that are nearer count as equal
constexpr double vanishing = 1e-7;          ///< of the size of a component
constexpr double degenerate_margin = 1e-6;  ///< of the size of a component: smaller margins are refused
constexpr double grazing = 1e-6;            ///< T |c'| of the size of c, likewise
constexpr double agreed = 1e-5;             ///< of its terms, what has to vanish at a switch to first order
constexpr double share_of_terms = 1e-2;     ///< the size of a component is at least this share of its terms

[[noreturn]] void not_differentiable(const std::string& found, const std::string& remedy) {
  throw Error("derivative", "not differentiable here: " + found, remedy);
}

const char* const other_data = "change the data slightly";

// The values that a row is applied to get jet^T v.
JetValues back(const Jet& c, const Vector& v) {
  return {c.x.transpose() * v, c.f.transpose() * v,  c.df.transpose() * v,
          c.g.transpose() * v, c.dg.transpose() * v, c.ddg.transpose() * v};
}

Jet operator+(const Jet& a, const Jet& b) {
  return {a.x + b.x, a.f + b.f, a.df + b.df, a.g + b.g, a.dg + b.dg, a.ddg + b.ddg};
}

Jet absolute_of(const Jet& c) {
  return {c.x.cwiseAbs(), c.f.cwiseAbs(), c.df.cwiseAbs(), c.g.cwiseAbs(), c.dg.cwiseAbs(), c.ddg.cwiseAbs()};
}

// c with the state replaced by D.
Jet compose(const Jet& c, const Jet& D) {
  return {c.x * D.x, c.x * D.f + c.f, c.x * D.df + c.df, c.x * D.g + c.g, c.x * D.dg + c.dg, c.x * D.ddg + c.ddg};
}

bool small_against(const Matrix& value, const Matrix& terms) {
  if (value.size() == 0) return true;
  const double floor = 1e-9 * terms.maxCoeff();
  return ((value.cwiseAbs() - agreed * (terms.array() + floor).matrix()).array() <= 0).all();
}

}  // namespace

struct SwitchedTape::Bounded {
  Jet value, terms;

  static Bounded of(const Jet& c) { return {c, absolute_of(c)}; }
  friend Bounded operator+(const Bounded& a, const Bounded& b) { return {a.value + b.value, a.terms + b.terms}; }
  friend Bounded operator*(const Matrix& left, const Bounded& c) {
    return {left * c.value, Matrix(left.cwiseAbs()) * c.terms};
  }
  Bounded after(const Bounded& D) const { return {compose(value, D.value), compose(terms, D.terms)}; }
  bool vanishes() const {
    return small_against(value.x, terms.x) && small_against(value.f, terms.f) && small_against(value.df, terms.df) &&
           small_against(value.g, terms.g) && small_against(value.dg, terms.dg) && small_against(value.ddg, terms.ddg);
  }
};

SwitchedTape::SwitchedTape(const Scene& scene, const EventSolution& s, const Vector& times)
    : m_(scene.states()), n_(scene.constraints()), T_(scene.T), t_(times) {
  const DenseDynamics& d = *scene.dynamics->small_state();
  system_ = {d.A, d.B, d.N, to_dense(scene.M)};
  add_pieces(scene, s);
  find_sizes();
  add_parts(s, scene.breakpoints);
  measure();
  judge_M();
}

std::vector<double> SwitchedTape::switch_times() const {
  std::vector<double> all;
  for (const Switch& s : switches_)
    if (s.moves) all.push_back(s.t);
  return all;
}

const SwitchedTape::Mode* SwitchedTape::mode_of(const std::vector<Index>& active) {
  const auto known = modes_.find(active);
  if (known != modes_.end()) return &known->second;
  std::optional<SwitchedMode> rows = make_switched_mode(system_, active);
  if (!rows) not_differentiable("an active set does not determine y", "remove constraints that repeat each other");
  Matrix A = Matrix::Zero(m_ + n_, m_ + n_);
  A.topLeftCorner(m_, m_) = rows->A;
  A.bottomLeftCorner(n_, m_) = rows->y.x;
  return &modes_.emplace(active, Mode{std::move(*rows), std::move(A)}).first->second;
}

const PartMaps* SwitchedTape::maps_of(const Mode* mode, double length) {
  const auto key = std::make_pair(mode, std::llround(std::ldexp(length / T_, 48)));
  const auto known = maps_.find(key);
  return known != maps_.end() ? &known->second : &maps_.emplace(key, part_maps(mode->A, length)).first->second;
}

void SwitchedTape::add_pieces(const Scene& scene, const EventSolution& s) {
  const EventSources sources(scene);
  for (const EventPiece& p : s.pieces) {
    if (p.passed)
      not_differentiable(text("switches accumulate, or a kink is not known exactly, at t = %.6g", p.begin), other_data);
    const EventSources::Polynomials given = sources.sample(p.begin, p.length);
    const Matrix rate = p.x * system_.A.transpose() + p.y * system_.B.transpose() + given.f;
    pieces_.push_back({mode_of(p.active),
                       p.begin,
                       p.length,
                       std::min(1.0, (p.end - p.begin) / p.length),
                       p.x,
                       p.y,
                       rate,
                       {given.f, given.g}});
  }
}

// Row i of y or w as the mode has it: of w where i is not active.
SwitchedTape::Bounded SwitchedTape::component(const Mode& mode, Index i) const {
  const Bounded y = Bounded::of(mode.rows.y);
  const bool active = std::binary_search(mode.rows.active.begin(), mode.rows.active.end(), i);
  if (active) return Matrix(Matrix::Identity(n_, n_).row(i)) * y;
  Jet rest = Jet::zero(1, m_, n_);
  rest.x = system_.N.row(i);
  rest.g(0, i) = 1;
  return Matrix(system_.M.row(i)) * y + Bounded::of(rest);
}

Vector SwitchedTape::polynomial(const Piece& p, Index i) const {
  const std::vector<Index>& S = p.mode->rows.active;
  if (std::binary_search(S.begin(), S.end(), i)) return p.y.col(i);
  return p.x * system_.N.row(i).transpose() + p.y * system_.M.row(i).transpose() + p.sources.g.col(i);
}

JetValues SwitchedTape::values_of(const Sources& s, const Piece& p, double at) const {
  const Matrix& D = Collocation::get().derivative;
  const Vector e0 = legendre(at), e1 = D.transpose() * e0 / p.length, e2 = D.transpose() * e1 / p.length;
  return {Vector::Zero(m_),     s.f.transpose() * e0, s.f.transpose() * e1,
          s.g.transpose() * e0, s.g.transpose() * e1, s.g.transpose() * e2};
}

void SwitchedTape::add_values(const JetValues& bar, const Piece& p, double at, Sources& to) const {
  const Matrix& D = Collocation::get().derivative;
  const Vector e0 = legendre(at), e1 = D.transpose() * e0 / p.length, e2 = D.transpose() * e1 / p.length;
  to.f += e0 * bar.f.transpose() + e1 * bar.df.transpose();
  to.g += e0 * bar.g.transpose() + e1 * bar.dg.transpose() + e2 * bar.ddg.transpose();
}

Vector SwitchedTape::rate_of(const Mode& mode, const JetValues& u) const {
  return system_.A * u.x + system_.B * evaluate(mode.rows.y, u) + u.f;
}

// The largest value of each component so far, or a share of the sum of its terms if that is larger.
void SwitchedTape::find_sizes() {
  Vector most_y = Vector::Constant(n_, 1e-290), most_w = most_y;
  for (Piece& p : pieces_) {
    JetValues u = values_of(p.sources, p, 0);
    for (Vector* v : {&u.f, &u.df, &u.g, &u.dg, &u.ddg}) *v = v->cwiseAbs();
    u.x = p.x.cwiseAbs().colwise().sum().transpose();
    const Vector of_y = terms(p.mode->rows.y, u), y = p.y.cwiseAbs().colwise().sum().transpose();
    const Vector of_w = system_.N.cwiseAbs() * u.x + system_.M.cwiseAbs() * y + u.g;
    for (Index i = 0; i < n_; ++i) {
      const std::vector<Index>& S = p.mode->rows.active;
      const bool active = std::binary_search(S.begin(), S.end(), i);
      double& most = active ? most_y[i] : most_w[i];
      const Vector c = polynomial(p, i);
      for (const double at : {0.0, 0.25, 0.5, 0.75, 1.0})
        most = std::max(most, std::abs(legendre(at * p.until).dot(c)));
      most = std::max(most, share_of_terms * (active ? of_y[i] : of_w[i]));
    }
    p.most_y = most_y;
    p.most_w = most_w;
  }
}

double SwitchedTape::size_of(const Piece& p, Index i) const {
  const std::vector<Index>& S = p.mode->rows.active;
  return std::binary_search(S.begin(), S.end(), i) ? p.most_y[i] : p.most_w[i];
}

bool SwitchedTape::vanishes(const Piece& p, double at, Index i) const {
  return std::abs(legendre(at).dot(polynomial(p, i))) <= vanishing * size_of(p, i);
}

void SwitchedTape::add_parts(const EventSolution& s, const std::vector<double>& breakpoints) {
  Index row = 0;
  for (std::size_t k = 0; k < s.pieces.size(); ++k) {
    const EventPiece *before = k > 0 ? &s.pieces[k - 1] : nullptr, &p = s.pieces[k];
    const bool change = !before || before->event >= 0 || before->active != p.active || !p.impulses.empty();
    const Index first = Index(parts_.size());
    cut(Index(k), p.end, row);
    if (!change) continue;
    add_switch(s, k, breakpoints);
    if (Index(parts_.size()) > first) parts_[std::size_t(first)].change = Index(switches_.size()) - 1;
    check(switches_.back(), before ? &pieces_[k - 1] : nullptr, pieces_[k]);
  }
  for (Index j = 0; j < t_.size(); ++j)
    for (const Switch& w : switches_)
      if (w.moves && std::abs(w.t - t_[j]) <= at_switch * T_ && (one_sided_.empty() || one_sided_.back() != j))
        one_sided_.push_back(j);
}

void SwitchedTape::cut(Index piece, double end, Index& row) {
  const Piece& p = pieces_[std::size_t(piece)];
  double from = p.begin;
  while (from < end) {
    Part part{piece, (from - p.begin) / p.length, 0, nullptr, {}, 0};
    if (row < t_.size() - 1 && t_[row] <= from + same_time * T_) part.row = row++;
    part.interval = std::clamp<Index>(row - 1, 0, t_.size() - 2);
    const double to = row < t_.size() - 1 && t_[row] < end - same_time * T_ ? t_[row] : end;
    part.width = (to - from) / p.length;
    part.maps = maps_of(p.mode, to - from);
    part.inputs = restricted(part.from, part.width);
    parts_.push_back(std::move(part));
    from = to;
  }
}

// The switch before piece k.
void SwitchedTape::add_switch(const EventSolution& solution, std::size_t k, const std::vector<double>& breakpoints) {
  const Piece& to = pieces_[k];
  Switch s;
  s.t = to.begin;
  Vector x = k > 0 ? Vector(pieces_[k - 1].x.transpose() * legendre(pieces_[k - 1].until)) : Vector();
  if (k > 0) {
    const Piece& from = pieces_[k - 1];
    const Vector end = legendre(from.until);
    s.component = solution.pieces[k - 1].event;
    s.moves = s.component >= 0;
    s.rate_before = from.rate.transpose() * end;
    s.y_before = from.y.transpose() * end;
    if (s.moves) {
      const Vector c = polynomial(from, s.component);
      s.row = component(*from.mode, s.component).value;
      s.rate = end.dot(Collocation::get().derivative * c) / from.length;
      const double most = size_of(from, s.component);
      const double transversality = T_ * std::abs(s.rate) / most;
      if (!(std::abs(end.dot(c)) <= 1e-4 * most) || !(transversality > grazing))
        not_differentiable(text("a constraint is only touched at t = %.6g (a grazing switch)", s.t), other_data);
      if (transversality < margin_.transversality) margin_.transversality = transversality, margin_.grazing_time = s.t;
      for (const double t : breakpoints)
        if (std::abs(t - s.t) <= at_switch * T_)
          not_differentiable(text("a switch coincides with a breakpoint of the sources at t = %.6g", s.t), other_data);
    }
  } else {
    x = to.x.transpose() * legendre(0);
    for (const EventImpulse& p : solution.pieces[k].impulses) x -= system_.B * p.p;
  }
  s.rate_after = to.rate.transpose() * legendre(0);
  s.y_after = to.y.transpose() * legendre(0);
  JetValues u = values_of(to.sources, to, 0);
  for (const EventImpulse& p : solution.pieces[k].impulses) {
    const Mode* mode = mode_of(p.active);
    const Vector move = system_.B * p.p;
    x += move;
    u.x = x;
    s.impulses.push_back({mode, p.p, move, rate_of(*mode, u)});
  }
  switches_.push_back(std::move(s));
}

// The change of the state after the switch, as rows of that before; dt is one row.
SwitchedTape::Bounded SwitchedTape::saltation(const Switch& s, const Piece* before, Bounded& dt) const {
  Jet identity = Jet::zero(m_, m_, n_);
  identity.x.setIdentity();
  Bounded D = Bounded::of(identity);
  dt = Bounded::of(Jet::zero(1, m_, n_));
  if (before && before->mode->rows.constraints.x.rows() > 0) {
    const SwitchedMode& mode = before->mode->rows;
    const Matrix back = Eigen::CompleteOrthogonalDecomposition<Matrix>(mode.constraints.x).pseudoInverse();
    D = D + Matrix(-back) * Bounded::of(mode.constraints);  // all changes that keep the constraints
  }
  if (s.moves) {
    dt = Matrix{{-1 / s.rate}} * Bounded::of(s.row).after(D);
    D = D + Matrix(s.rate_before) * dt;
  }
  for (const Impulse& p : s.impulses) {
    const SwitchedMode& mode = p.mode->rows;
    const Matrix move = system_.B * mode.impulse;
    Bounded moved = D;
    if (s.moves) moved = D + Matrix(-p.rate) * dt;
    const Bounded impulse = mode.impulse * Bounded::of(mode.constraints).after(moved);
    for (const Index i : mode.active) {
      if (std::abs(p.p[i]) > vanishing * p.p.cwiseAbs().maxCoeff()) continue;
      const Matrix row = Matrix::Identity(n_, n_).row(i);
      if (!(row * impulse).vanishes())
        not_differentiable(text("the impulse of constraint %ld vanishes at t = %.6g", long(i), s.t), other_data);
    }
    D = D + system_.B * impulse;
  }
  if (s.moves) D = D + Matrix(-s.rate_after) * dt;
  return D;
}

// Whether the set after the switch stays the one after it: what vanishes there has to vanish with it.
void SwitchedTape::check(const Switch& s, const Piece* before, const Piece& after) const {
  const auto together = [&](Index i) {
    not_differentiable(text("y_%ld = w_%ld = 0 at t = %.6g, where another constraint switches or the data change",
                            long(i), long(i), s.t),
                       other_data);
  };
  Bounded dt;
  const Bounded D = saltation(s, before, dt);
  const Matrix& derivative = Collocation::get().derivative;
  const auto stays = [&](const Piece& p, double at, Index i, const Bounded& state) {
    const double rate = legendre(at).dot(derivative * polynomial(p, i)) / p.length;
    Bounded c = component(*p.mode, i).after(state);
    // A rate that is only rounding has the terms of one that is not.
    if (s.moves) {
      c.value = c.value + Matrix{{rate}} * dt.value;
      c.terms = c.terms + Matrix{{std::max(std::abs(rate), size_of(p, i) / T_)}} * dt.terms;
    }
    return c.vanishes();
  };
  if (before) {
    Switch none;
    Bounded no_dt;
    const Bounded state = saltation(none, before, no_dt);
    for (Index i = 0; i < n_; ++i)
      if (i != s.component && vanishes(*before, before->until, i) && !stays(*before, before->until, i, state))
        together(i);
  }
  for (Index i = 0; i < n_; ++i)
    if (vanishes(after, 0, i) && !stays(after, 0, i, D)) together(i);
  const SwitchedMode& mode = after.mode->rows;
  if (mode.constraints.x.rows() > 0 && !Bounded::of(mode.constraints).after(D).vanishes())
    not_differentiable(text("the state meets several constraints at once at t = %.6g", s.t), other_data);
}

void SwitchedTape::measure() {
  std::vector<Sample> run;
  const auto sample = [&](const Part& part, double share) {
    const Piece& p = piece_of(part);
    const double at = part.from + part.width * share;
    const Vector e = legendre(at);
    Vector c(n_);
    for (Index i = 0; i < n_; ++i) c[i] = e.dot(polynomial(p, i)) / size_of(p, i);
    run.push_back({p.begin + at * p.length, part.piece, std::move(c)});
  };
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    constexpr int samples = 8;
    const bool last = k + 1 == parts_.size(), run_ends = last || parts_[k + 1].change >= 0;
    const bool piece_ends = run_ends || parts_[k + 1].piece != parts_[k].piece;
    for (int i = 0; i < samples + (piece_ends ? 1 : 0); ++i) sample(parts_[k], double(i) / samples);
    if (!run_ends) continue;
    measure_run(run, last);
    run.clear();
  }
  if (margin_.margin <= degenerate_margin)
    not_differentiable(text("y_%ld = w_%ld = 0 at t = %.6g, where derivatives are one-sided", long(margin_.constraint),
                            long(margin_.constraint), margin_.time),
                       other_data);
}

// Local minima of the components between two switches. What vanishes at a switch was checked there.
void SwitchedTape::measure_run(const std::vector<Sample>& run, bool to_end) {
  const std::size_t count = run.size();
  for (Index i = 0; i < n_; ++i)
    for (std::size_t k = 0; k < count; ++k) {
      const bool inner = k > 0 && k + 1 < count;
      const double now = run[k].c[i], before = k > 0 ? run[k - 1].c[i] : INFINITY;
      const double after = k + 1 < count ? run[k + 1].c[i] : INFINITY;
      if (now > before || now > after) continue;
      double least = now;
      const double bend = before - 2 * now + after;
      // The vertex of the parabola through three samples, where they are of one polynomial.
      if (inner && bend > 0 && run[k - 1].piece == run[k + 1].piece) least -= std::pow(after - before, 2) / (8 * bend);
      const double near = at_switch * T_;
      const bool at_end = run[k].t - run.front().t <= near || (!to_end && run.back().t - run[k].t <= near);
      if (at_end && std::abs(least) <= vanishing) continue;
      least = std::max(0.0, least);
      if (least < margin_.margin) margin_.margin = least, margin_.time = run[k].t, margin_.constraint = i;
    }
}

void SwitchedTape::judge_M() {
  for (const auto& [active, mode] : modes_)
    if (mode.rows.constraints.x.rows() > 0 && without_M_.empty())
      without_M_ = "M_SS is singular on an active set, and a change of M can act from one side only";
  for (const Switch& s : switches_) {
    if (!without_M_.empty() || !s.moves || n_ == 0) continue;
    if (((s.y_after - s.y_before).cwiseAbs() - 1e-6 * pieces_.back().most_y).maxCoeff() > 0)
      without_M_ = text("y jumps at the switch at t = %.6g, and a change of M removes the jump", s.t);
  }
}

// Constraints on the state that are derivatives of w (a rigid contact) need N B = 0 there; changes have to keep it.
void SwitchedTape::check_structure(const DataChange& c) const {
  if (c.M.size() > 0 && (c.M.array() != 0).any() && !without_M_.empty())
    throw Error("M", without_M_, "ask for derivatives with respect to other data");
  if (c.B.size() == 0 && c.N.size() == 0) return;
  for (const auto& [active, mode] : modes_) {
    const Jet& rows = mode.rows.constraints;
    if (rows.x.rows() == 0 || !(rows.f.array() != 0).any()) continue;
    Matrix change = Matrix::Zero(rows.x.rows(), Index(active.size())), terms = change;
    if (c.B.size() > 0) {
      const Matrix dB = c.B(Eigen::all, active);
      change += rows.f * dB;
      terms += rows.f.cwiseAbs() * dB.cwiseAbs();
    }
    if (c.N.size() > 0) {
      const Matrix dg = rows.dg * c.N, B = system_.B(Eigen::all, active);
      change += dg * B;
      terms += rows.dg.cwiseAbs() * c.N.cwiseAbs() * B.cwiseAbs();
    }
    if (((change.cwiseAbs() - 1e-9 * terms).array() > 0).any())
      throw Error("derivative", "not differentiable here: the change makes N B nonzero, where y is a contact force",
                  "change B and N together so that N B stays 0");
  }
}

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
  return s;
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
  all << s.f + of_y * system_.B.transpose(), of_y;
  return part.inputs * all;
}

void SwitchedTape::add_inputs(const Part& part, const Matrix& bar, Sources& to) const {
  const Piece& p = piece_of(part);
  const Jet& y = p.mode->rows.y;
  const Matrix D = Collocation::get().derivative / p.length, all = part.inputs.transpose() * bar;
  const Matrix of_f = all.leftCols(m_), of_y = of_f * system_.B + all.rightCols(n_);
  to.f += of_f + of_y * y.f;
  to.g += of_y * y.g;
  if (p.mode->rows.uses_df) to.f += D.transpose() * of_y * y.df;
  if (p.mode->rows.uses_dg) to.g += D.transpose() * of_y * y.dg;
  if (p.mode->rows.uses_ddg) to.g += D.transpose() * (D.transpose() * of_y) * y.ddg;
}

void SwitchedTape::advance(const Part& part, const Sources& s, State& z) const {
  const PartMaps& maps = *part.maps;
  Vector both(m_ + n_);
  both << z.x, z.integral;
  const Matrix u = inputs(part, s);
  Vector next = maps.decay * both;
  for (Index k = 0; k <= tape_degree; ++k) next += maps.inputs[std::size_t(k)] * u.row(k).transpose();
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
  z.x += system_.B * p;
  z.integral += p;
}

void SwitchedTape::project_back(const Part& part, Sources& of, State& bar) const {
  const SwitchedMode& mode = piece_of(part).mode->rows;
  if (mode.constraints.x.rows() == 0) return;
  const Vector p = system_.B.transpose() * bar.x + bar.integral;
  const JetValues u = back(mode.constraints, mode.impulse.transpose() * p);
  bar.x += u.x;
  add_values(u, piece_of(part), part.from, of);
}

void SwitchedTape::pass(const Switch& s, const Part* before, const Sources& of_before, const Part& after,
                        const Sources& of_after, const DataChange& c, State& z) const {
  double dt = 0;
  if (s.moves) {
    JetValues u = values_of(of_before, piece_of(*before), before->from + before->width);
    u.x = z.x;
    dt = -evaluate(s.row, u)[0] / s.rate;
    z.x += dt * s.rate_before;
    z.integral += dt * s.y_before;
  }
  for (const Impulse& p : s.impulses) {
    if (c.B.size() > 0) z.x += c.B * p.p;
    if (c.E.size() > 0) z.x += c.E * p.move;
    const SwitchedMode& mode = p.mode->rows;
    JetValues u = values_of(of_after, piece_of(after), after.from);
    u.x = s.moves ? Vector(z.x - dt * p.rate) : z.x;
    const Vector q = mode.impulse * evaluate(mode.constraints, u);
    z.x += system_.B * q;
    z.integral += q;
  }
  if (!s.moves) return;
  z.x -= dt * s.rate_after;
  z.integral -= dt * s.y_after;
}

void SwitchedTape::pass_back(const Switch& s, const Part* before, Sources& of_before, const Part& after,
                             Sources& of_after, DataChange& to, State& bar) const {
  double dt = 0;
  if (s.moves) dt -= s.rate_after.dot(bar.x) + s.y_after.dot(bar.integral);
  for (auto p = s.impulses.rbegin(); p != s.impulses.rend(); ++p) {
    const SwitchedMode& mode = p->mode->rows;
    const Vector q = system_.B.transpose() * bar.x + bar.integral;
    const JetValues u = back(mode.constraints, mode.impulse.transpose() * q);
    bar.x += u.x;
    if (s.moves) dt -= p->rate.dot(u.x);
    add_values(u, piece_of(after), after.from, of_after);
    to.B += bar.x * p->p.transpose();
    to.E += bar.x * p->move.transpose();
  }
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
  to.w.row(row) = (system_.N * z.x + system_.M * y + u.g).transpose();
  to.integral.row(row) = z.integral.transpose();
}

void SwitchedTape::read(Index row, const Part& part, double at, const SolutionChange& from, State& bar,
                        Sources& of) const {
  Vector of_y = Vector::Zero(n_), of_w = of_y;
  if (from.y.size() > 0) of_y += from.y.row(row).transpose();
  if (from.w.size() > 0) of_w += from.w.row(row).transpose();
  JetValues u = back(piece_of(part).mode->rows.y, of_y + system_.M.transpose() * of_w);
  u.g += of_w;
  bar.x += u.x + system_.N.transpose() * of_w;
  if (from.x.size() > 0) bar.x += from.x.row(row).transpose();
  if (from.integral.size() > 0) bar.integral += from.integral.row(row).transpose();
  add_values(u, piece_of(part), at, of);
}

SolutionChange SwitchedTape::jvp(const DataChange& c) const {
  check_structure(c);
  const Index rows = t_.size();
  SolutionChange out{RowMatrix::Zero(rows, n_), RowMatrix::Zero(rows, m_), RowMatrix::Zero(rows, n_),
                     RowMatrix::Zero(rows, n_)};
  State z{c.x0.size() > 0 ? c.x0 : Vector::Zero(m_), Vector::Zero(n_)};
  const Part* before = nullptr;
  Sources last = no_sources();
  for (const Part& part : parts_) {
    const Sources s = changed(part, c);
    if (part.change >= 0) pass(switches_[std::size_t(part.change)], before, last, part, s, c, z);
    project(part, s, z);
    if (part.row >= 0) write(part.row, part, part.from, z, s, out);
    advance(part, s, z);
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
  State bar{Vector::Zero(m_), Vector::Zero(n_)};
  Sources sources = no_sources();
  read(rows - 1, parts_.back(), parts_.back().from + parts_.back().width, of, bar, sources);
  for (std::size_t k = parts_.size(); k-- > 0;) {
    const Part& part = parts_[k];
    Sources before = no_sources();
    advance_back(part, sources, bar);
    if (part.row >= 0) read(part.row, part, part.from, of, bar, sources);
    project_back(part, sources, bar);
    if (part.change >= 0)
      pass_back(switches_[std::size_t(part.change)], k > 0 ? &parts_[k - 1] : nullptr, before, part, sources, to, bar);
    add_changed(part, sources, to);
    sources = std::move(before);
  }
  to.x0 = bar.x;
  if (!without_M_.empty()) to.M.resize(0, 0);
  return to;
}

}  // namespace bromwich
