#include "core/events/event_step.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr double rounding_tail = 1e-10;   ///< of last coefficients: below, rounding is the cause where it stays
constexpr double noise_share = 10;        ///< of the tolerance: negative values below count as zero
constexpr double unseen = 1e-3;           ///< of the state: what rounding of y may move
constexpr double shortest_share = 1e-14;  ///< of T
constexpr double of_source = 100;         ///< one value of one component of a source, in floating-point operations
constexpr double overhead = 4000;         ///< of a step, likewise

// Coefficients of the part of rows of a jet that does not depend on x.
LegendreCoefficients without_x(const Jet& rows, const EventStep& p) {
  LegendreCoefficients sum = p.sources.f * rows.f.transpose() + p.sources.g * rows.g.transpose();
  if (p.df.size() > 0) sum += p.df * rows.df.transpose();
  if (p.dg.size() > 0) sum += p.dg * rows.dg.transpose();
  if (p.ddg.size() > 0) sum += p.ddg * rows.ddg.transpose();
  return sum;
}

// The last two coefficients, or a difference that was seen, relative to the sizes. Coefficients up to `rounding` count
// as zero.
double tail(const LegendreCoefficients& c, const Vector& size, const Vector& off, const Vector& rounding) {
  if (size.size() == 0) return 0;
  const double floor = 1e-4 * size.maxCoeff() + 1e-280;
  double largest = 0;
  for (Index i = 0; i < c.cols(); ++i) {
    double last = std::abs(c(degree, i)) + std::abs(c(degree - 1, i));
    if (rounding.size() > 0) last = std::max(0.0, last - rounding[i]);
    const double seen = off.size() > 0 ? off[i] : 0;
    const double share = std::max(last, seen) / std::max(size[i], floor);
    if (!std::isfinite(share)) return INFINITY;
    largest = std::max(largest, share);
  }
  return largest;
}

// Coefficients of Legendre polynomials bound the values.
Vector largest(const LegendreCoefficients& c) { return c.cwiseAbs().colwise().sum().transpose(); }

Vector larger(const Vector& before, const LegendreCoefficients& c) {
  if (c.size() == 0) return before;
  return before.cwiseMax(largest(c));
}

// d^k/dt^k of polynomials on a step of length h. Within a short step it may be rounding of the values, and is zero
// then.
LegendreCoefficients derivative(const LegendreCoefficients& values, int k, double h) {
  static const Collocation::Square& D = Collocation::get().derivative;
  static const double steepest = D.cwiseAbs().colwise().sum().maxCoeff();
  LegendreCoefficients c = values;
  double grown = 64 * epsilon;
  for (int i = 0; i < k; ++i) {
    c = (D * c / h).eval();
    grown *= steepest / h;
  }
  for (Index i = 0; i < c.cols(); ++i)
    if (c.col(i).cwiseAbs().sum() <= grown * values.col(i).cwiseAbs().sum()) c.col(i).setZero();
  return c;
}

// Bounds the derivatives on [0, 1].
Vector largest_slope(const LegendreCoefficients& c) {
  return (Collocation::get().derivative * c).cwiseAbs().colwise().sum().transpose();
}

// h (I - hA)^{-1}: how constant inputs move the state in a step of implicit Euler. Fast modes that decay count with the
// states to which they tend, and not with h times their rates. Where a mode grows much, this is singular or too small:
// h I.
Matrix moved_within(double h, const Matrix& A) {
  constexpr double much = 0.5;
  const Matrix I = Matrix::Identity(A.rows(), A.rows());
  if (A.rows() > 0 && h * Eigen::EigenSolver<Matrix>(A, false).eigenvalues().real().maxCoeff() > much) return h * I;
  return h * (I - h * A).partialPivLu().inverse();
}

// Sizes of the numbers that made M. Where a reduction of larger equations has left M_ij, its rounding is not that of
// M_ij but of these, |M_ij M_ji| = M_ii M_jj at most. No change of units changes that.
Matrix sizes_behind(const Matrix& M) {
  Matrix size = M.cwiseAbs();
  for (Index i = 0; i < M.rows(); ++i)
    for (Index j = 0; j < i; ++j) {
      const double both = size(i, j) * size(j, i);
      const double grown = both > 0 ? std::sqrt(std::abs(M(i, i) * M(j, j)) / both) : 1;
      if (grown > 1) size(i, j) *= grown, size(j, i) *= grown;
    }
  return size;
}

// Whether a polynomial is nowhere above `zero` before `at`, where it is below -zero.
bool is_never_above(const LegendreValues& coefficients, double at, double zero) {
  constexpr int looks = 16;
  for (int k = 0; k < looks; ++k)
    if (coefficients.dot(legendre(at * k / looks)) > zero) return false;
  return true;
}

}  // namespace

EventSizes EventSizes::with(const EventStep& step) const {
  return {{larger(u.x, step.x), larger(u.f, step.sources.f), larger(u.df, step.df), larger(u.g, step.sources.g),
           larger(u.dg, step.dg), larger(u.ddg, step.ddg)},
          larger(y, step.y)};
}

void EventSizes::include(const EventStep& step) { *this = with(step); }

EventSteps::EventSteps(const SystemMatrices& system, const EventSources& sources, double T, double span,
                       double tolerance, double longest)
    : system_(system),
      sources_(sources),
      T_(T),
      tolerance_(tolerance),
      longest_(longest),
      rigid_((openings(system).array() > 0).any()),
      sizes_behind_M_(sizes_behind(system.M)),
      by_f_within_span_(moved_within(span, system.A)),
      by_y_within_span_((by_f_within_span_ * system.B).cwiseAbs()),
      by_f_within_step_(moved_within(longest, system.A)),
      by_y_within_step_((by_f_within_step_ * system.B).cwiseAbs()) {
  by_f_within_span_ = by_f_within_span_.cwiseAbs();
  by_f_within_step_ = by_f_within_step_.cwiseAbs();
  const auto is_position = [&](Index i) {
    const auto apart = [&](Index k) { return system.A(i, k) == 0 && system.A(k, i) == 0; };
    return system.B.row(i).isZero(0) && apart(i) && std::all_of(positions_.begin(), positions_.end(), apart);
  };
  for (Index i = 0; i < system.states(); ++i) (is_position(i) ? positions_ : others_).push_back(i);
  by_others_ = system.A(positions_, others_);
}

double EventSteps::noise() const { return noise_share * tolerance_; }

void EventSteps::sample(const SwitchedMode& mode, double t, double h, EventStep& step) const {
  step.sources = sources_.sample(t, h);
  if (mode.uses_df) step.df = derivative(step.sources.f, 1, h);
  if (mode.uses_dg) step.dg = derivative(step.sources.g, 1, h);
  if (mode.uses_ddg) step.ddg = derivative(step.sources.g, 2, h);
}

double EventSteps::sample_resolved(const SwitchedMode& mode, const EventPoint& p, EventStep& step) const {
  constexpr int most_shortened = 12;
  double h = longest_from(p) / 16;
  for (int k = 0;; ++k, h /= 4) {
    sample(mode, p.t, h, step);
    if (k == most_shortened || source_defect(p.sizes.with(step).u, step.sources) <= 0.1 * tolerance_) return h;
  }
}

double EventSteps::source_defect(const JetValues& size, const EventSources::Polynomials& p) const {
  return std::max(tail(p.f, size.f, p.off_f, {}), tail(p.g, size.g, p.off_g, {}));
}

// I - z A_S, z = h lambda, for the eigenvalues lambda of the Radau matrix. With positions Q and other states V it is
//
//     [I, -z A_QV; -z A_VQ, I - z A_VV],
//
// and that for V alone is I - z A_VV - z^2 A_VQ A_QV.
void EventSteps::factorize(const SwitchedMode& mode, double h, double& work) {
  if (factored_mode_ == &mode && factored_h_ == h) return;
  by_positions_ = mode.A(others_, positions_);
  const Matrix A = mode.A(others_, others_), twice = by_positions_ * by_others_;
  factors_.clear();
  const ComplexMatrix identity = ComplexMatrix::Identity(A.rows(), A.rows());
  for (const auto& e : Collocation::get().eigenvalues) {
    const Complex z = h * e.value;
    factors_.emplace_back(identity - z * A.cast<Complex>() - (z * z) * twice.cast<Complex>());
  }
  factored_mode_ = &mode;
  factored_h_ = h;
  work += 12 * std::pow(double(A.rows()), 3);
}

// (I - z A_S)^{-1} of the right-hand side.
ComplexVector EventSteps::solve(std::size_t k, const ComplexVector& right) const {
  const Complex z = factored_h_ * Collocation::get().eigenvalues[k].value;
  const ComplexVector of_positions = right(positions_);
  const ComplexVector others = factors_[k].solve(ComplexVector(right(others_) + z * (by_positions_ * of_positions)));
  ComplexVector all(right.size());
  all(others_) = others;
  all(positions_) = of_positions + z * (by_others_ * others);
  return all;
}

EventStep EventSteps::attempt(const SwitchedMode& mode, EventPoint& p, double h) {
  const Collocation& c = Collocation::get();
  const Index m = system_.states(), n = system_.constraints();
  EventStep step;
  step.length = h;
  sample(mode, p.t, h, step);
  const LegendreCoefficients y_of_sources = without_x(mode.y, step);
  // Z = X - x0, so that rounding is relative to the change of x: errors of many short steps would add up otherwise.
  LegendreCoefficients input = step.sources.f + y_of_sources * system_.B.transpose();
  input.row(0) += (mode.A * p.x).transpose();
  using AtStages = Eigen::Matrix<double, degree, Eigen::Dynamic>;
  const AtStages right = h * (c.integrals * input);  // degree x m
  factorize(mode, h, p.work);
  AtStages change = AtStages::Zero(degree, m), left = right;
  step.x.setZero(degree + 1, m);
  // Twice: the eigenvectors of the Radau matrix are ill-conditioned.
  for (int refined = 0; refined < 2; ++refined) {
    for (std::size_t k = 0; k < factors_.size(); ++k) {
      const auto& e = c.eigenvalues[k];
      const ComplexVector z = solve(k, left.transpose().cast<Complex>() * e.left);
      change += e.weight * (e.right * z.transpose()).real();
    }
    step.x = c.coefficients.rightCols(degree) * change;
    if (refined == 0) left = right - change + h * (c.integrals * step.x) * mode.A.transpose();
  }
  step.x.row(0) += p.x.transpose();
  step.y = step.x * mode.y.x.transpose() + y_of_sources;
  step.w = step.x * system_.N.transpose() + step.y * system_.M.transpose() + step.sources.g;
  const EventSizes& size = step.sizes = p.sizes.with(step);
  set_zeros(mode, p, step);
  step.defect = std::max({tail(step.x, size.u.x, {}, rounding_of_x(size)), source_defect(size.u, step.sources),
                          defect_of_signs(mode, step)});
  p.work +=
      double((degree + 1) * (degree + 1) * (6 * m + 3 * n) + 80 * m * m + (degree + 1) * (4 * m * n + 2 * n * n)) +
      overhead;
  p.work += double(c.samples.size() + c.checks.size()) * work_of_sources();
  return step;
}

// Whether the conditions of the mode on f and g hold on the step.
bool EventSteps::sources_agree(const SwitchedMode& mode, const JetValues& size, const EventStep& step) const {
  if (mode.conditions.g.rows() == 0) return true;
  const Vector off = without_x(mode.conditions, step).cwiseAbs().colwise().sum().transpose();
  return !((off - 30 * noise() * terms(mode.condition_terms, size)).array() > 0).any();
}

// Whether values of y that count as zero move the state between two breakpoints, where their sign is chosen anew, by
// less than `unseen` of it, or of what y moves: otherwise terms of y cancel so far, by a small entry of M say, that its
// sign is not known.
bool EventSteps::y_is_known(const SwitchedMode& mode, const EventStep& step) const {
  const JetValues& size = step.sizes.u;
  const Vector moved = by_y_within_span_ * step.zero_y, by_f = by_f_within_span_ * size.f,
               by_y = by_y_within_span_ * largest(step.y);
  return moved.maxCoeff() <= unseen * size.x.cwiseMax(by_f).cwiseMax(by_y).maxCoeff();
}

Vector EventSteps::rounding_of_x(const EventSizes& sizes) const {
  return 64 * epsilon * (by_f_within_step_ * sizes.u.f + by_y_within_step_ * sizes.y);
}

// Negative values that count as zero are of a solution nearby. Where that is another one, with y_i > 0 and w_i = 0,
// y_i is about -w_i / M_ii. Without M_ii it would move the state, and its error is that of x.
Vector EventSteps::doubt(const SwitchedMode& mode, const EventStep& step) const {
  const Collocation& c = Collocation::get();
  Vector off = Vector::Zero(system_.constraints());
  std::size_t k = 0;
  for (Index i = 0; i < off.size(); ++i) {
    const bool active = k < mode.active.size() && mode.active[k] == i;
    if (active) ++k;
    if (!active && !(system_.M(i, i) > 0)) continue;
    const Vector values = c.stages * (active ? step.y : step.w).col(i);
    for (Index j = 0; j < values.size() && c.nodes[j] <= step.valid; ++j) off[i] = std::max(off[i], -values[j]);
    off[i] = std::max(0.0, off[i] - (active ? step.rounding_y : step.rounding_w)[i]) / (active ? 1 : system_.M(i, i));
  }
  return off;
}

// Rounding of u on a step: of the values there and of M y, of x' in a state that its terms hold at zero, and of the
// derivatives of sources. What has decayed to eps^2 of its largest value is zero.
JetValues EventSteps::rounding_of(const EventStep& step) const {
  static const double steepest = Collocation::get().derivative.cwiseAbs().colwise().sum().maxCoeff();
  const auto& [f, g, off_f, off_g, unknown_f, unknown_g] = step.sources;
  const double grown = steepest / step.length;
  JetValues u;
  u.x = 64 * epsilon * (largest(step.x) + by_f_within_step_ * largest(f) + by_y_within_step_ * largest(step.y)) +
        epsilon * epsilon * step.sizes.u.x;
  u.f = 64 * epsilon * largest(f) + unknown_f;
  u.g = 64 * epsilon * (largest(g) + sizes_behind_M_ * largest(step.y)) + unknown_g;
  u.df = grown * (4 * epsilon * largest(f) + unknown_f);
  u.dg = grown * (4 * epsilon * largest(g) + unknown_g);
  u.ddg = grown * u.dg;
  return u;
}

// What counts as zero of y and w: their rounding, what changes within that of t, and the error of a resolved polynomial
// beside its own size on the step.
void EventSteps::set_zeros(const SwitchedMode& mode, const EventPoint& p, EventStep& step) const {
  const JetValues& size = step.sizes.u;
  const JetValues rounding = rounding_of(step);
  const double of_t = 4 * epsilon * T_ / step.length;
  const Vector of_y = terms(mode.y, rounding);
  step.rounding_y = of_y + of_t * largest_slope(step.y);
  step.rounding_w =
      system_.N.cwiseAbs() * rounding.x + system_.M.cwiseAbs() * of_y + rounding.g + of_t * largest_slope(step.w);
  // Of rigid contacts beside the largest terms so far: bounces that are lower end.
  step.zero_y = step.rounding_y + noise() * (rigid_ ? terms(mode.y, size) : largest(step.y));
  step.zero_w = step.rounding_w + noise() * (rigid_ ? terms(mode.w, size) : largest(step.w));
  if (rigid_) return;
  // w that the mode holds at zero is zero, and what counted as zero at the end of the step before still does.
  const Vector of_w = largest(step.w);
  for (const Index i : mode.active) step.zero_w[i] = std::max(step.zero_w[i], of_w[i]);
  if (p.zero_w.size() == 0) return;
  const LegendreValues at = legendre(0);
  const auto keep = [&at](Vector& zero, const Vector& before, const LegendreCoefficients& values) {
    zero = zero.cwiseMax(before.cwiseMin(-(values.transpose() * at)));
  };
  keep(step.zero_y, p.zero_y + step.rounding_y, step.y);
  keep(step.zero_w, p.zero_w + step.rounding_w, step.w);
}

// Last coefficients of y and w beside their own sizes on the step, where their sign may depend on them.
double EventSteps::defect_of_signs(const SwitchedMode& mode, const EventStep& step) const {
  if (rigid_) return 0;
  const Collocation& c = Collocation::get();
  double defect = 0;
  std::size_t k = 0;
  for (Index i = 0; i < system_.constraints(); ++i) {
    const bool active = k < mode.active.size() && mode.active[k] == i;
    if (active) ++k;
    const LegendreValues of_sign = (active ? step.y : step.w).col(i);
    const double last = std::abs(of_sign[degree]) + std::abs(of_sign[degree - 1]);
    const double unknown = last - (active ? step.rounding_y : step.rounding_w)[i];
    if (!(unknown > 0) || (c.bernstein * of_sign).minCoeff() > 4 * last) continue;
    defect = std::max(defect, unknown / of_sign.cwiseAbs().sum());
  }
  return defect;
}

// The part of the step on which y and w are nonnegative.
void EventSteps::find_event(const SwitchedMode& mode, const std::vector<char>* free, EventStep& step) const {
  const Collocation& c = Collocation::get();
  const JetValues& size = step.sizes.u;
  if (!sources_agree(mode, size, step)) {
    step.valid = 0;
    step.event = mode.active.front();
    step.at_once = true;
    step.doubt = Vector::Zero(system_.constraints());
    return;
  }
  step.valid = 1;
  step.event = -1;
  step.at_once = false;
  LegendreValues of_event;
  double zero_of_event = 0;
  std::size_t k = 0;
  for (Index i = 0; i < system_.constraints(); ++i) {
    const bool active = k < mode.active.size() && mode.active[k] == i;
    if (active) ++k;
    if (free && (*free)[std::size_t(i)]) continue;
    const double zero = (active ? step.zero_y : step.zero_w)[i] + 1e-290;
    const LegendreValues coefficients = (active ? step.y : step.w).col(i);
    const double at = first_below(c.bernstein * coefficients, zero);
    if (at >= step.valid) continue;
    step.valid = at;
    step.event = i;
    of_event = coefficients;
    zero_of_event = zero;
  }
  if (step.event >= 0) step.at_once = is_never_above(of_event, step.valid, zero_of_event);
  if (step.event >= 0 && step.valid > 0) step.valid = zero_before(of_event, step.valid);
  step.doubt = doubt(mode, step);
}

// Of one value of f and of g.
double EventSteps::work_of_sources() const {
  return sources_.any() ? of_source * double(system_.states() + system_.constraints()) : 0;
}

// Looks at the sources at more times: both ends, and times between the samples of a long step.
void EventSteps::look_closer(EventPoint& p, EventStep& step) const {
  if (!sources_.any()) return;
  sources_.look_at_ends(p.t, step.length, step.sources);
  p.work += double(2 + sources_.look_between(p.t, step.length, step.sources)) * work_of_sources();
  step.defect = std::max(step.defect, source_defect(step.sizes.u, step.sources));
}

bool EventSteps::resolve(const SwitchedMode& mode, EventPoint& p, EventStep& step, const std::vector<char>* free) {
  double h = longest_from(p);
  double before = INFINITY;
  bool shortened = false;
  for (int k = 0; k < 80; ++k) {
    step = attempt(mode, p, h);
    step.shortened = shortened;
    // Where a shorter step does not help, rounding is left: t is known to 1e-16, and sin(1e5 t) to 1e-11. (A transient
    // far shorter than the step stays too, but is larger.)
    const bool rounding = step.defect <= rounding_tail && step.defect > 0.5 * before;
    if (step.defect <= tolerance_) look_closer(p, step);
    if (step.defect <= tolerance_ || rounding) {
      find_event(mode, free, step);
      const bool known = y_is_known(mode, step);
      if (!known) sign_is_lost_ = true;
      return known;
    }
    if (h < shortest_share * T_) return false;
    before = step.defect;
    shortened = true;
    h *= std::isfinite(step.defect)
             ? std::clamp(0.9 * std::pow(tolerance_ / step.defect, 1.0 / double(degree)), 0.1, 0.7)
             : 0.1;
  }
  return false;
}

}  // namespace bromwich
