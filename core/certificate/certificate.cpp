#include "core/certificate/certificate.hpp"

#include "core/accuracy/convergence.hpp"
#include "core/certificate/part_sources.hpp"
#include "core/certificate/part_weights.hpp"
#include "core/dynamics/dense.hpp"
#include "core/events/event_driven.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr Index division = 3;          ///< parts of a step: odd, since nested grids may miss the same contact
constexpr int most_halvings = 6;       ///< of a part, for sources
constexpr double sign_of_zero = 1e-9;  ///< of the largest value: smaller ones have no sign
constexpr double no_size = 1e-8;       ///< of what terms could make of a component: smaller values are their rounding

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

class Certifier {
 public:
  Certifier(const Scene& scene, const Result& result, const RowMatrix& states)
      : scene_(scene),
        r_(result),
        states_(states),
        d_(*scene.dynamics->small_state()),
        M_(to_dense(scene.M)),
        y_(result),
        sources_(scene),
        weights_(d_.A, d_.B, d_.N, M_, sources_.has_f()),
        n_(scene.constraints()),
        terms_(Vector::Zero(n_)),
        largest_y_(r_.y.bottomRows(r_.steps).cwiseAbs().colwise().maxCoeff().transpose()),
        given_(scene.x0),
        x_(scene.x0),
        integral_(Vector::Zero(n_)) {
    const RowMatrix largest = states_.size() > 0 ? states_ : RowMatrix(scene.x0.transpose());
    off_.x = off_.sum_of_x = Vector::Zero(scene.states());
    off_.size_of_x = largest.cwiseAbs().colwise().maxCoeff().transpose();
    off_.y = off_.mean = off_.defect = off_.sum_of_defect = defect_at_ = answers_ = Vector::Zero(n_);
    effect_.resize(scene.states() + n_, n_);
    effect_ << d_.B, M_;
    off_.effect = off_.size_of_effect = Vector::Zero(effect_.rows());
  }

  Certificate run(const std::vector<double>& breakpoints) {
    for (const Part& p : divide(r_.t, breakpoints, division))
      if (!pass(p, most_halvings)) {
        c_.until = p.from / scene_.T;
        break;
      }
    if (ended_ > 0) end_step(last_);
    summarise();
    return c_;
  }

 private:
  bool pass(const Part& p, int halvings) {
    const PartSources s = sources_.on(p);
    if (halvings > 0 && !sources_.resolves(p, s)) {
      const auto [first, second] = halves(p);
      return pass(first, halvings - 1) && pass(second, halvings - 1);
    }
    PartWeights& w = weights_.of(p.length);
    Vector Y(2 * n_);
    for (std::size_t i = 0; i < 2; ++i)
      Y.segment(Index(i) * n_, n_) = y_.at(p.step, p.begin + part_nodes[i] * (p.end - p.begin));
    look_inside(p, w, s, Y);
    bool kept = true;
    if (!(p.behind_jump ? jump(w, s, Y) : correct(w, s, Y, kept))) return false;
    if (!kept) c_.share_of_sets += p.length / scene_.T;
    // An impulse is no limit of y: the part behind it has that.
    if (ended_ > 0 && !p.behind_jump) end_step(1.5 * Y.head(n_) - 0.5 * Y.tail(n_));
    integral_ += p.length * (0.75 * Y.head(n_) + 0.25 * Y.tail(n_));
    if (p.end < 1) return true;
    ended_ = p.step;
    last_ = Y.tail(n_);
    at_end_ = x_;
    integral_at_end_ = integral_;
    given_at_end_ = given_;
    return true;
  }

  // x and N x + g at both nodes, without y.
  Vector free(const PartWeights& w, const PartSources& s, const Vector& x, std::array<Vector, 2>& next) const {
    Vector q(2 * n_);
    for (std::size_t i = 0; i < 2; ++i) {
      next[i].noalias() = w.decay[i] * x;
      for (std::size_t k = 0; k < 3 && sources_.has_f(); ++k) next[i].noalias() += w.input[i][k] * s.f[k];
      q.segment(Index(i) * n_, n_) = d_.N * next[i] + s.g[i];
    }
    return q;
  }

  // The given y: its state, and the defect of complementarity at the nodes.
  void look_inside(const Part& p, const PartWeights& w, const PartSources& s, const Vector& Y) {
    std::array<Vector, 2> next;
    const Vector q = free(w, s, given_, next), slack = q + w.slack * Y;
    for (std::size_t i = 0; i < 2; ++i) {
      next[i].noalias() += w.drive[i] * Y;
      terms_ = terms_.cwiseMax(M_.cwiseAbs() * Y.segment(Index(i) * n_, n_).cwiseAbs() +
                               d_.N.cwiseAbs() * next[i].cwiseAbs() + s.g[i].cwiseAbs());
    }
    given_ = next[1];
    answers_ = answers_.cwiseMax(w.slack.diagonal().tail(n_));
    for (Index i = 0; i < 2 * n_; ++i) {
      const Index row = i % n_;
      const double off = std::abs(std::min(slack[i], w.slack(i, i) * Y[i]));
      off_.sum_of_defect[row] += (i < n_ ? 0.75 : 0.25) * p.length / scene_.T * off;
      if (!(off > off_.defect[row])) continue;
      off_.defect[row] = off;
      defect_at_[row] = (p.from + part_nodes[std::size_t(i / n_)] * (p.to - p.from)) / scene_.T;
    }
  }

  // The brief part behind a jump: y is constant, since Radau's two values of an impulse are of no sign.
  bool jump(PartWeights& w, const PartSources& s, Vector& Y) {
    std::array<Vector, 2> next;
    const Vector q = free(w, s, x_, next).tail(n_);
    Vector y = Y.tail(n_).cwiseMax(0);
    if (q.minCoeff() >= 0) {
      y.setZero();
    } else {
      w.constant_lcp->start_from(y);
      if (!w.constant_lcp->solve(q, y).solved) return false;
    }
    Y << y, y;
    x_ = next[1] + w.constant_drive * y;
    return true;
  }

  // Y and x by the sets of Y where they continue the solution, otherwise by those that solve the part.
  bool correct(PartWeights& w, const PartSources& s, Vector& Y, bool& kept) {
    std::array<Vector, 2> next;
    const Vector q = free(w, s, x_, next);
    kept = hold(w, q, Y);
    if (!kept) {
      Vector weighted = q;
      weighted.head(n_) *= 0.75;
      weighted.tail(n_) *= 0.25;
      w.lcp->start_from(Y.cwiseMax(0));
      if (!w.lcp->solve(weighted, Y).solved) return false;
    }
    x_ = next[1] + w.drive[1] * Y;
    return true;
  }

  // Y of the sets of the given one; whether all signs are right.
  bool hold(const PartWeights& w, const Vector& q, Vector& Y) {
    held_.clear();
    for (Index i = 0; i < 2 * n_; ++i)
      if (Y[i] > sign_of_zero * largest_y_[i % n_]) held_.push_back(i);
    Y.setZero();
    if (!held_.empty()) Y(held_) = -w.slack(held_, held_).partialPivLu().solve(q(held_));
    if (!Y.allFinite()) return false;
    const Vector slack = q + w.slack * Y;
    const double largest = Y.cwiseAbs().maxCoeff();
    auto held = held_.begin();
    for (Index i = 0; i < 2 * n_; ++i) {
      const bool active = held != held_.end() && *held == i;
      held += active;
      if (active ? !(Y[i] >= -sign_of_zero * std::max(largest_y_[i % n_], largest))
                 : !(slack[i] >= -sign_of_zero * terms_[i % n_]))
        return false;
    }
    return true;
  }

  // Row j, at the end of the last step. It may have the limit of y from either side; `first` is the one behind it.
  void end_step(const Vector& first) {
    const Index j = std::exchange(ended_, 0);
    const auto apart = [&](const Vector& a, const Vector& b, const Vector& row) {
      return Vector((a.cwiseMin(b) - row).cwiseMax(row - a.cwiseMax(b)).cwiseMax(0));
    };
    const Vector y = r_.y.row(j).transpose();
    off_.y = off_.y.cwiseMax(apart(last_, first, y));
    off_.effect = off_.effect.cwiseMax(apart(effect_ * last_, effect_ * first, effect_ * y));
    off_.size_of_effect = off_.size_of_effect.cwiseMax((effect_ * y).cwiseAbs());
    off_.mean = off_.mean.cwiseMax((integral_at_end_ - y_.integral().row(j).transpose()).cwiseAbs() / scene_.T);
    const Vector x = states_.size() > 0 ? Vector(states_.row(j).transpose()) : given_at_end_;
    const Vector off = (x - at_end_).cwiseAbs();
    off_.x = off_.x.cwiseMax(off);
    off_.sum_of_x += off;
    off_.size_of_x = off_.size_of_x.cwiseMax(x.cwiseAbs());
  }

  void summarise() {
    const ComponentSizes sizes;
    const Index m = scene_.states();
    const Vector least_x = no_size * scene_.T * off_.size_of_effect.head(m),
                 least_y = (answers_.array() > 0).select(no_size * terms_.cwiseQuotient(answers_), 0.0);
    const Vector size_of_x = sizes.of(off_.size_of_x).cwiseMax(least_x),
                 size_of_effect = sizes.of(off_.size_of_effect).cwiseMax(effect_.cwiseAbs() * least_y);
    c_.error_of_x = largest_share(off_.x, size_of_x);
    c_.typical_error_of_x = largest_share(off_.sum_of_x / double(r_.steps), size_of_x);
    c_.error_of_y =
        std::min(largest_share(off_.y, sizes.of_y(r_).cwiseMax(least_y)), largest_share(off_.effect, size_of_effect));
    c_.error_of_mean = largest_share(off_.mean, sizes.of_mean(r_).cwiseMax(least_y));
    const Vector size_of_w = terms_.cwiseMax(1e-290);
    c_.mean_defect = off_.sum_of_defect.cwiseQuotient(size_of_w).maxCoeff();
    c_.largest_defect = off_.defect.cwiseQuotient(size_of_w).maxCoeff(&c_.defect_row);
    c_.defect_at = defect_at_[c_.defect_row];
  }

  const Scene& scene_;
  const Result& r_;
  const RowMatrix& states_;
  const DenseDynamics& d_;
  const Matrix M_;
  Matrix effect_;  ///< B above M: what y does to x and w
  const LinearSteps y_;
  PartSampler sources_;
  PartWeightsFamily weights_;
  const Index n_;
  Vector terms_;            ///< largest sizes of the terms of w so far
  const Vector largest_y_;  ///< of the result
  Vector given_, x_;        ///< states of the given y and of the corrected one
  Vector integral_;         ///< of the corrected y
  Index ended_ = 0;         ///< the step that has ended, and is not compared yet; 0: none
  Vector last_, at_end_, given_at_end_, integral_at_end_;  ///< y, both states and the integral of y there
  Vector defect_at_;
  Vector answers_;  ///< largest change of w_i by y_i within a part
  std::vector<Index> held_;
  struct {
    Vector x, sum_of_x, size_of_x, y, mean, effect, size_of_effect, defect, sum_of_defect;
  } off_;
  Certificate c_;
};

}  // namespace

std::optional<Certificate> certify(const Scene& scene, const Result& result, const std::vector<double>& breakpoints,
                                   const RowMatrix& states) {
  if (!unsuited_to_events(scene).empty() || scene.constraints() == 0) return std::nullopt;
  if (result.steps < 1 || result.y.rows() != result.steps + 1 || !result.y.bottomRows(result.steps).allFinite())
    return std::nullopt;
  if (states.size() > 0 && (states.rows() != result.steps + 1 || states.cols() != scene.states())) return std::nullopt;
  return Certifier(scene, result, states).run(breakpoints);
}

}  // namespace bromwich
