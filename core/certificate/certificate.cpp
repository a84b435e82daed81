#include "core/certificate/certificate.hpp"

#include "core/accuracy/convergence.hpp"
#include "core/certificate/part_sources.hpp"
#include "core/certificate/part_weights.hpp"
#include "core/dynamics/dense.hpp"
#include "core/events/event_driven.hpp"
#include "core/lcp/lcp_class.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index division = 3;                 ///< parts of a step: odd, since nested grids may miss the same contact
constexpr int most_halvings = 6;              ///< of a part, for sources
constexpr double no_size = 1e-8;              ///< of what terms could make of a component: smaller is their rounding
constexpr double near_row = 1e-6;             ///< of a step: a switch so near may be on either side of a row
constexpr std::size_t one_of = 20;            ///< rows: one may be off by more than the typical error
constexpr double reference_tolerance = 1e-9;  ///< of the located solution
constexpr double most_work = 4e8;             ///< likewise, floating-point operations: a tenth of a second, about

// y of a result, linear on each step: its value at the right end and its mean.
class LinearSteps {
 public:
  explicit LinearSteps(const Result& r) : right_(r.y), integral_(integral_of_y(r)) {
    const Index J = r.y.rows() - 1;
    left_ = r.y.topRows(J);
    if (r.continuous && !by_euler(r) && r.y.row(0).allFinite()) return;
    for (Index j = 1; j <= J; ++j)
      left_.row(j - 1) = 2 * (integral_.row(j) - integral_.row(j - 1)) / (r.t[j] - r.t[j - 1]) - r.y.row(j);
  }
  Vector at(Index step, double place) const {
    return ((1 - place) * left_.row(step - 1) + place * right_.row(step)).transpose();
  }
  const RowMatrix& integral() const { return integral_; }

 private:
  const RowMatrix& right_;
  RowMatrix integral_, left_;
};

// The state that y of a result drives, and the defect of complementarity inside its steps.
class Defect {
 public:
  Defect(const Scene& scene, const Matrix& M, const LinearSteps& y)
      : d_(*scene.dynamics->small_state()),
        M_(M),
        T_(scene.T),
        n_(scene.constraints()),
        y_(y),
        sources_(scene),
        weights_(d_.A, d_.B, d_.N, M_, sources_.has_f()),
        x_(scene.x0),
        terms_(Vector::Zero(n_)),
        answers_(terms_),
        largest_(terms_),
        sum_(terms_),
        at_(terms_) {}

  void pass(const Part& p, int halvings = most_halvings) {
    const PartSources s = sources_.on(p);
    if (halvings > 0 && !sources_.resolves(p, s)) {
      for (const Part& half : halves(p)) pass(half, halvings - 1);
      return;
    }
    look_inside(p, weights_.of(p.length), s);
  }

  const Vector& x() const { return x_; }              ///< m, at the end of the last part
  const Vector& terms() const { return terms_; }      ///< n: max_t (|M||y| + |N||x| + |g|)
  const Vector& answers() const { return answers_; }  ///< n: the largest change of w_i by y_i within a part

  void summarise(Certificate& c) const {
    const Vector size = terms_.cwiseMax(1e-290);
    c.mean_defect = sum_.cwiseQuotient(size).maxCoeff();
    c.largest_defect = largest_.cwiseQuotient(size).maxCoeff(&c.defect_row);
    c.defect_at = at_[c.defect_row];
  }

 private:
  void look_inside(const Part& p, const PartWeights& w, const PartSources& s) {
    Vector Y(2 * n_);
    for (std::size_t i = 0; i < 2; ++i)
      Y.segment(Index(i) * n_, n_) = y_.at(p.step, p.begin + part_nodes[i] * (p.end - p.begin));
    for (std::size_t i = 0; i < 2; ++i) {
      const Vector y = Y.segment(Index(i) * n_, n_);
      Vector x = w.decay[i] * x_ + w.drive[i] * Y;
      for (std::size_t k = 0; k < 3 && sources_.has_f(); ++k) x.noalias() += w.input[i][k] * s.f[k];
      const Vector slack = M_ * y + d_.N * x + s.g[i], off = slack.cwiseMin(w.answer[i].cwiseProduct(y)).cwiseAbs();
      terms_ = terms_.cwiseMax(M_.cwiseAbs() * y.cwiseAbs() + d_.N.cwiseAbs() * x.cwiseAbs() + s.g[i].cwiseAbs());
      answers_ = answers_.cwiseMax(w.answer[i]);
      sum_ += (i == 0 ? 0.75 : 0.25) * p.length / T_ * off;
      at_ = (off.array() > largest_.array()).select((p.from + part_nodes[i] * (p.to - p.from)) / T_, at_);
      largest_ = largest_.cwiseMax(off);
      if (i == 1) x_ = x;
    }
  }

  const DenseDynamics& d_;
  const Matrix& M_;
  const double T_;
  const Index n_;
  const LinearSteps& y_;
  PartSampler sources_;
  PartWeightsFamily weights_;
  Vector x_, terms_, answers_, largest_, sum_, at_;
};

// How far a result is from a located solution, at its rows. Where y jumps, a row may have either limit.
class Distances {
 public:
  Distances(const EventSolution& located, const Scene& scene, const Result& r, const LinearSteps& y,
            const Matrix& effect)
      : located_(located), T_(scene.T), r_(r), y_(y), effect_(effect), x_size_(scene.x0.cwiseAbs()) {
    y_off_ = mean_off_ = y_size_ = Vector::Zero(r.y.cols());
    effect_off_ = effect_size_ = Vector::Zero(effect.rows());
    x_off_ = Vector::Zero(x_size_.size());
  }

  void add(Index j, const Vector& x) {
    const double near = near_row * (r_.t[j] - r_.t[j - 1]), before = r_.t[j] - near,
                 behind = std::min(r_.t[j] + near, T_);
    const Vector left = located_.y(before, true), right = located_.y(behind, false), y = r_.y.row(j).transpose();
    y_off_ = y_off_.cwiseMax(outside(left, right, y));
    effect_off_ = effect_off_.cwiseMax(outside(effect_ * left, effect_ * right, effect_ * y));
    effect_size_ = effect_size_.cwiseMax((effect_ * y).cwiseAbs()).cwiseMax((effect_ * right).cwiseAbs());
    y_size_ = y_size_.cwiseMax(y.cwiseAbs()).cwiseMax(right.cwiseAbs());
    const Vector integral = y_.integral().row(j).transpose();
    mean_off_ = mean_off_.cwiseMax(
        outside(located_.integral_of_y(before, true), located_.integral_of_y(behind, false), integral));
    const Vector true_x = located_.x(behind, false), off = outside(located_.x(before, true), true_x, x);
    x_off_ = x_off_.cwiseMax(off);
    x_size_ = x_size_.cwiseMax(x.cwiseAbs()).cwiseMax(true_x.cwiseAbs());
    of_rows_.push_back(largest_share(off, size_of_x()));
  }

  void summarise(const Defect& defect, Certificate& c) const {
    const ComponentSizes sizes;
    const Vector least_y =
        (defect.answers().array() > 0).select(no_size * defect.terms().cwiseQuotient(defect.answers()), 0.0);
    const Vector size_of_effect = sizes.of(effect_size_).cwiseMax(effect_.cwiseAbs() * least_y);
    c.error_of_x = largest_share(x_off_, size_of_x());
    std::vector<double> rows = of_rows_;
    const auto place = rows.begin() + std::ptrdiff_t(rows.size() - 1 - rows.size() / one_of);
    std::nth_element(rows.begin(), place, rows.end());
    c.typical_error_of_x = *place;
    c.error_of_y = std::min(largest_share(y_off_, sizes.of(y_size_).cwiseMax(least_y)),
                            largest_share(effect_off_, size_of_effect));
    c.error_of_mean = largest_share(mean_off_ / T_, sizes.of_mean(r_).cwiseMax(least_y));
    c.impulses = located_.jumps > 0;
  }

 private:
  // Of the values so far.
  Vector size_of_x() const {
    return ComponentSizes().of(x_size_).cwiseMax(no_size * T_ * effect_size_.head(x_size_.size()));
  }
  static Vector outside(const Vector& a, const Vector& b, const Vector& row) {
    return (a.cwiseMin(b) - row).cwiseMax(row - a.cwiseMax(b)).cwiseMax(0);
  }

  const EventSolution& located_;
  const double T_;
  const Result& r_;
  const LinearSteps& y_;
  const Matrix& effect_;  ///< B above M: what y does to x and w
  Vector x_size_, y_off_, y_size_, mean_off_, effect_off_, effect_size_, x_off_;
  std::vector<double> of_rows_;  ///< of x, relative to the values so far
};

}  // namespace

std::optional<Certificate> certify(const Scene& scene, const Result& r, const std::vector<double>& breakpoints,
                                   const RowMatrix& states) {
  if (!unsuited_to_events(scene).empty() || scene.constraints() == 0) return std::nullopt;
  if (r.steps < 1 || r.y.rows() != r.steps + 1 || !r.y.bottomRows(r.steps).allFinite()) return std::nullopt;
  if (states.size() > 0 && (states.rows() != r.steps + 1 || states.cols() != scene.states())) return std::nullopt;
  EventOptions options;
  options.tolerance = reference_tolerance;
  options.most_work = most_work;
  const EventSolution located =
      integrate_with_events(scene, selection_class(scene.M, scene.lcp_class), breakpoints, options);
  if (!located.complete || !located.unique) return std::nullopt;

  const Matrix M = to_dense(scene.M);
  Matrix effect(scene.states() + scene.constraints(), scene.constraints());
  effect << scene.dynamics->small_state()->B, M;
  const LinearSteps y(r);
  Defect defect(scene, M, y);
  Distances distances(located, scene, r, y, effect);
  const std::vector<Part> parts = divide(r.t, breakpoints, division);
  for (std::size_t k = 0; k < parts.size(); ++k) {
    defect.pass(parts[k]);
    const Index j = parts[k].step;
    if (k + 1 < parts.size() && parts[k + 1].step == j) continue;
    distances.add(j, states.size() > 0 ? Vector(states.row(j).transpose()) : defect.x());
  }
  Certificate c;
  defect.summarise(c);
  distances.summarise(defect, c);
  return c;
}

}  // namespace bromwich
