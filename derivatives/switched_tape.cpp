#include "derivatives/switched_tape.hpp"

#include "core/base/text.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

using namespace switched;

namespace {

constexpr double same_time = 1e-12;         ///< of T
constexpr double degenerate_margin = 1e-6;  ///< of the size of a component: smaller margins are refused
constexpr double grazing = 1e-6;            ///< T |c'| of the size of c, likewise
constexpr double share_of_terms = 1e-2;     ///< the size of a component is at least this share of its terms
/// And of the largest component of y or w, in natural units: a component that is only rounding has no size of its own.
constexpr double share_of_largest = 1e-8;

}  // namespace

SwitchedTape::SwitchedTape(const Scene& scene, const EventSolution& s, const Vector& times, bool along_some)
    : m_(scene.states()), n_(scene.constraints()), T_(scene.T), t_(times), along_some_(along_some) {
  add_pieces(scene, s);
  find_sizes(s);
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

namespace {

// Without coefficients that are rounding of those beside them: the currents of two elements in series are equal.
void leave_out_rounding(Jet& rows) {
  constexpr double rounding = 1e-13;
  for (Matrix* block : {&rows.x, &rows.f, &rows.df, &rows.g, &rows.dg, &rows.ddg})
    for (Index i = 0; i < block->rows(); ++i) {
      const double least = block->cols() > 0 ? rounding * block->row(i).cwiseAbs().maxCoeff() : 0;
      for (Index k = 0; k < block->cols(); ++k)
        if (std::abs((*block)(i, k)) <= least) (*block)(i, k) = 0;
    }
}

}  // namespace

const Regime* SwitchedTape::regime_of(const Scene& scene, const std::vector<Index>& modes) {
  const auto known = regimes_.find(modes);
  return known != regimes_.end() ? &known->second : &regimes_.try_emplace(modes, scene, modes).first->second;
}

const SwitchedTape::Mode* SwitchedTape::mode_of(const Rows& active) {
  const auto known = modes_.find(active);
  if (known != modes_.end()) return &known->second;
  std::optional<SwitchedMode> rows = make_switched_mode(active.first->system, active.second);
  if (!rows)
    not_differentiable_at_switch("an active set does not determine y", "remove constraints that repeat each other");
  leave_out_rounding(rows->y);
  Matrix A = Matrix::Zero(m_ + n_, m_ + n_);
  A.topLeftCorner(m_, m_) = rows->A;
  A.bottomLeftCorner(n_, m_) = rows->y.x;
  Bounded kept = Bounded::identity(m_, n_);
  if (const Jet& constraints = rows->constraints; constraints.x.rows() > 0) {
    const Matrix back = Eigen::CompleteOrthogonalDecomposition<Matrix>(constraints.x).pseudoInverse();
    kept = kept + Matrix(-back) * Bounded::of(constraints);
  }
  return &modes_.emplace(active, Mode{active.first, std::move(*rows), std::move(A), std::move(kept)}).first->second;
}

const PartMaps* SwitchedTape::maps_of(const Mode* mode, double length) {
  const auto key = std::make_pair(mode, std::llround(std::ldexp(length / T_, 48)));
  const auto known = maps_.find(key);
  return known != maps_.end() ? &known->second : &maps_.emplace(key, part_maps(mode->A, length)).first->second;
}

void SwitchedTape::add_pieces(const Scene& scene, const EventSolution& s) {
  for (const EventPiece& p : s.pieces) {
    if (p.passed)
      not_differentiable_at_switch(text("switches accumulate, or a kink is not known exactly, at t = %.6g", p.begin),
                                   "");
    const Regime* regime = regime_of(scene, p.modes);
    const EventSources::Polynomials given = regime->sources.sample(p.begin, p.length);
    const Matrix rate = p.x * regime->system.A.transpose() + p.y * regime->system.B.transpose() + given.f;
    pieces_.push_back({mode_of({regime, p.active}),
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
  rest.x = mode.system().N.row(i);
  rest.g(0, i) = 1;
  return Matrix(mode.system().M.row(i)) * y + Bounded::of(rest);
}

Vector SwitchedTape::polynomial(const Piece& p, Index i) const {
  const std::vector<Index>& S = p.mode->rows.active;
  if (std::binary_search(S.begin(), S.end(), i)) return p.y.col(i);
  const SystemMatrices& system = p.mode->system();
  return p.x * system.N.row(i).transpose() + p.y * system.M.row(i).transpose() + p.sources.g.col(i);
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
  return mode.system().A * u.x + mode.system().B * evaluate(mode.rows.y, u) + u.f;
}

// The largest value of each component so far, or a share of the sum of its terms if that is larger. What an impulse
// moves is a term: after it, a state on a constraint may be of the size of its rounding.
void SwitchedTape::find_sizes(const EventSolution& s) {
  Vector most_y = Vector::Constant(n_, 1e-290), most_w = most_y;
  for (std::size_t k = 0; k < pieces_.size(); ++k) {
    Piece& p = pieces_[k];
    const SystemMatrices& system = p.mode->system();
    JetValues u = sizes_of(values_of(p.sources, p, 0));
    u.x = p.x.cwiseAbs().colwise().sum().transpose();
    for (const EventImpulse& impulse : s.pieces[k].impulses) u.x += (system.B * impulse.p).cwiseAbs();
    const Vector of_y = terms(p.mode->rows.y, u), y = p.y.cwiseAbs().colwise().sum().transpose();
    const Vector of_w = system.N.cwiseAbs() * u.x + system.M.cwiseAbs() * y + u.g;
    for (Index i = 0; i < n_; ++i) {
      const std::vector<Index>& S = p.mode->rows.active;
      const bool active = std::binary_search(S.begin(), S.end(), i);
      double& most = active ? most_y[i] : most_w[i];
      const Vector c = polynomial(p, i);
      for (const double at : {0.0, 0.25, 0.5, 0.75, 1.0})
        most = std::max(most, std::abs(legendre(at * p.until).dot(c)));
      most = std::max(most, share_of_terms * (active ? of_y[i] : of_w[i]));
    }
    p.most_y = most_y.cwiseMax(share_of_largest * (n_ > 0 ? most_y.maxCoeff() : 0));
    p.most_w = most_w.cwiseMax(share_of_largest * (n_ > 0 ? most_w.maxCoeff() : 0));
  }
}

double SwitchedTape::size_of(const Piece& p, Index i) const {
  const std::vector<Index>& S = p.mode->rows.active;
  return std::binary_search(S.begin(), S.end(), i) ? p.most_y[i] : p.most_w[i];
}

bool SwitchedTape::vanishes(const Piece& p, double at, Index i) const {
  return std::abs(legendre(at).dot(polynomial(p, i))) <= vanishing_component * size_of(p, i);
}

// Whether the motion beyond a zero of active component i is the one before it: another constraint, at zero as long as
// the set is active, takes its place, as where the current of a closed switch changes its direction.
bool SwitchedTape::is_alike_beyond(const Mode& mode, Index i) {
  if (const auto known = alike_beyond_.find({&mode, i}); known != alike_beyond_.end()) return known->second;
  const std::vector<Index>& S = mode.rows.active;
  const SystemMatrices& system = mode.system();
  bool& found = alike_beyond_[{&mode, i}] = false;
  if (!std::binary_search(S.begin(), S.end(), i)) return false;
  for (Index j = 0; j < n_ && !found; ++j) {
    if (std::binary_search(S.begin(), S.end(), j) || !component(mode, j).after(mode.kept).vanishes()) continue;
    std::vector<Index> beyond = S;
    *std::lower_bound(beyond.begin(), beyond.end(), i) = j;
    std::sort(beyond.begin(), beyond.end());
    const std::optional<SwitchedMode> other = make_switched_mode(system, beyond);
    if (!other || other->constraints.x.rows() != mode.rows.constraints.x.rows()) continue;
    const Bounded difference = Bounded::of(other->y) + Matrix(-Matrix::Identity(n_, n_)) * Bounded::of(mode.rows.y);
    found = (system.B * difference).vanishes() && (system.M * difference).after(mode.kept).vanishes();
  }
  return found;
}

void SwitchedTape::add_parts(const EventSolution& s, const std::vector<double>& breakpoints) {
  Index row = 0;
  for (std::size_t k = 0; k < s.pieces.size(); ++k) {
    const EventPiece *before = k > 0 ? &s.pieces[k - 1] : nullptr, &p = s.pieces[k];
    const bool change =
        !before || before->event >= 0 || before->active != p.active || before->modes != p.modes || !p.impulses.empty();
    const Index first = Index(parts_.size());
    cut(Index(k), p.end, row);
    if (!change) continue;
    add_switch(s, k, breakpoints);
    if (Index(parts_.size()) > first) parts_[std::size_t(first)].change = Index(switches_.size()) - 1;
    check(switches_.back(), before ? &pieces_[k - 1] : nullptr, pieces_[k]);
  }
  for (Index j = 0; j < t_.size(); ++j)
    for (const Switch& w : switches_)
      if (w.moves && std::abs(w.t - t_[j]) <= near_switch * T_ && (one_sided_.empty() || one_sided_.back() != j))
        one_sided_.push_back(j);
}

void SwitchedTape::cut(Index piece, double end, Index& row) {
  const Piece& p = pieces_[std::size_t(piece)];
  double from = p.begin;
  while (from < end) {
    Part part{piece, (from - p.begin) / p.length, 0, nullptr, {}, 0};
    part.first_row = row;
    while (row < t_.size() - 1 && t_[row] <= from + same_time * T_) part.row = row++;
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
  const Matrix& B = to.mode->system().B;
  Switch s;
  s.t = to.begin;
  s.set = solution.pieces[k].set;
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
        not_differentiable_at_switch(text("a constraint is only touched at t = %.6g (a grazing switch)", s.t), "");
      if (transversality < margin_.transversality) margin_.transversality = transversality, margin_.grazing_time = s.t;
      for (const double t : breakpoints)
        if (std::abs(t - s.t) <= near_switch * T_)
          not_differentiable_at_switch(text("a switch coincides with a breakpoint of the sources at t = %.6g", s.t),
                                       other_switch_data);
    }
  }
  Vector start = to.x.transpose() * legendre(0);
  for (const EventImpulse& p : solution.pieces[k].impulses) start -= B * p.p;
  if (k == 0) x = start;
  for (const Index j : s.set) x[j] = start[j];
  s.rate_after = to.rate.transpose() * legendre(0);
  s.y_after = to.y.transpose() * legendre(0);
  JetValues u = values_of(to.sources, to, 0);
  JetValues left = k > 0 ? values_of(pieces_[k - 1].sources, pieces_[k - 1], pieces_[k - 1].until) : u, rates = left;
  rates.f = rates.df, rates.g = rates.dg, rates.dg = rates.ddg;
  for (const EventImpulse& p : solution.pieces[k].impulses) {
    const Mode* mode = mode_of({to.mode->regime, p.active});
    const Vector move = B * p.p;
    left.x = x;
    x += move;
    u.x = x;
    const Jet back = rebound(mode->system(), mode->rows, p.e);
    s.impulses.push_back(
        {mode, p.p, move, rate_of(*mode, u), back, evaluate(back, rates), by_restitution(*mode, p, left)});
  }
  switches_.push_back(std::move(s));
}

void SwitchedTape::measure() {
  std::vector<Sample> run;
  const auto sample = [&](const Part& part, double share) {
    const Piece& p = piece_of(part);
    const double at = part.from + part.width * share;
    const Vector e = legendre(at);
    Vector c(n_);
    for (Index i = 0; i < n_; ++i) c[i] = e.dot(polynomial(p, i)) / size_of(p, i);
    run.push_back({p.begin + at * p.length, part.piece, std::size_t(&part - parts_.data()), std::move(c)});
  };
  for (std::size_t k = 0; k < parts_.size(); ++k) {
    constexpr int samples = 8;
    const bool last = k + 1 == parts_.size(), run_ends = last || parts_[k + 1].change >= 0;
    // The end of a part is the begin of the next: values there that differ by rounding are no minimum.
    for (int i = 0; i < samples + (run_ends ? 1 : 0); ++i) sample(parts_[k], double(i) / samples);
    if (!run_ends) continue;
    measure_run(run, last);
    run.clear();
  }
  if (margin_.margin <= degenerate_margin)
    not_differentiable_at_switch(text("y_%ld = w_%ld = 0 at t = %.6g, where derivatives are one-sided",
                                      long(margin_.constraint), long(margin_.constraint), margin_.time),
                                 other_switch_data);
}

// The least value of component i between the samples beside sample k, by golden sections of each polynomial.
double SwitchedTape::least_beside(const std::vector<Sample>& run, std::size_t k, Index i) const {
  constexpr double golden = 0.6180339887498949;
  constexpr int sections = 36;  // of the interval 3e-8 is left, and of the value above the least one its square
  const Sample &first = run[k > 0 ? k - 1 : k], &last = run[std::min(k + 1, run.size() - 1)];
  double least = run[k].c[i];
  for (Index number = first.piece; number <= last.piece; ++number) {
    const Piece& p = pieces_[std::size_t(number)];
    const Vector c = polynomial(p, i) / size_of(p, i);
    const auto value = [&](double at) { return legendre(at).dot(c); };
    double low = std::max(0.0, (first.t - p.begin) / p.length), high = std::min(p.until, (last.t - p.begin) / p.length);
    if (!(high > low)) continue;
    double a = high - golden * (high - low), b = low + golden * (high - low), at_a = value(a), at_b = value(b);
    for (int section = 0; section < sections; ++section) {
      least = std::min({least, at_a, at_b});
      if (at_a < at_b) {
        high = b, b = a, at_b = at_a;
        at_a = value(a = high - golden * (high - low));
      } else {
        low = a, a = b, at_a = at_b;
        at_b = value(b = low + golden * (high - low));
      }
    }
  }
  return least;
}

// Whether component i, which is zero on the piece of these samples, may be so: it stays zero with all changes, or
// along_some.
bool SwitchedTape::may_rest(const std::vector<Sample>& run, std::size_t first, std::size_t last, Index i) {
  const Mode& mode = *pieces_[std::size_t(run[first].piece)].mode;
  const Bounded rows = component(mode, i).after(mode.kept);
  const bool always = rows.vanishes();
  if (!always && !along_some_) return false;
  std::vector<Index> together = mode.rows.active;
  if (!std::binary_search(together.begin(), together.end(), i)) together.push_back(i);
  find_ambiguity({mode.regime, together});
  if (!always) add_condition(text("y_%ld = w_%ld = 0 from t = %.6g on", long(i), long(i), run[first].t), rows, false);
  for (std::size_t k = first; k < last; ++k)
    if (std::vector<Index>& known = parts_[run[k].part].rests; !always && (known.empty() || known.back() != i))
      known.push_back(i);
  return true;
}

// The samples of pieces on which component i is zero and may be so, as w_i of two bounds that coincide. Zeros beside
// such a piece belong to it.
std::vector<char> SwitchedTape::resting(const std::vector<Sample>& run, Index i) {
  const auto zero = [&](std::size_t k) { return std::abs(run[k].c[i]) <= degenerate_margin; };
  std::vector<char> found(run.size(), 0);
  for (std::size_t first = 0, last = 0; first < run.size(); first = last) {
    bool all = true;
    for (last = first; last < run.size() && run[last].piece == run[first].piece; ++last) all = all && zero(last);
    if (!all || !may_rest(run, first, last, i)) continue;
    std::fill(found.begin() + std::ptrdiff_t(first), found.begin() + std::ptrdiff_t(last), 1);
    for (std::size_t k = first; k > 0 && zero(k - 1); --k) found[k - 1] = 1;
    for (std::size_t k = last; k < run.size() && zero(k); ++k) found[k] = 1;
  }
  return found;
}

// Local minima of the components between two switches. What vanishes at a switch was checked there.
void SwitchedTape::measure_run(const std::vector<Sample>& run, bool to_end) {
  constexpr double looked_at = 0.1;  // smaller samples are beside minima that may be the least
  const std::size_t count = run.size();
  for (Index i = 0; i < n_; ++i) {
    const std::vector<char> rests = resting(run, i);
    for (std::size_t k = 0; k < count; ++k) {
      const double now = run[k].c[i], before = k > 0 ? run[k - 1].c[i] : INFINITY;
      const double after = k + 1 < count ? run[k + 1].c[i] : INFINITY;
      if (now > before || now > after || rests[k]) continue;
      const double near = near_switch * T_;
      const bool at_end = run[k].t - run.front().t <= near || (!to_end && run.back().t - run[k].t <= near);
      if (at_end && std::abs(now) <= vanishing_component) continue;
      const bool by_rest = (k > 0 && rests[k - 1]) || (k + 1 < count && rests[k + 1]);
      const double least = std::max(0.0, now < looked_at && !by_rest ? least_beside(run, k, i) : now);
      if (least < margin_.margin && !is_alike_beyond(*pieces_[std::size_t(run[k].piece)].mode, i))
        margin_.margin = least, margin_.time = run[k].t, margin_.constraint = i;
    }
  }
}

}  // namespace bromwich
