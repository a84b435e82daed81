#include "tests/support/oracle_events.hpp"

#include "tests/support/oracle_collocation.hpp"
#include "tests/support/oracle_modes.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

namespace bromwich::oracle {
namespace {

constexpr Index degree = Collocation::degree;
constexpr double resolved = 1e-12;     ///< bound on last coefficients, relative to the largest values so far
constexpr double noise_level = 3e-11;  ///< counts as zero, relative to the terms of a sum
constexpr double same_state = 1e-7;
constexpr long most_events = 20000, most_pieces = 60000;

double value_at(const Vector& c, double s) {
  const double z = 2 * s - 1;
  double before = 1, now = z, sum = c[0] + c[1] * z;
  for (Index k = 1; k < degree; ++k) {
    const double next = ((2 * double(k) + 1) * z * now - double(k) * before) / (double(k) + 1);
    before = now;
    now = next;
    sum += c[k + 1] * now;
  }
  return sum;
}

/// First time at which a polynomial on [0, 1] that is nonnegative at 0 becomes negative.
class SignChange {
 public:
  SignChange(const Vector& c, double noise) : c_(c), noise_(noise) {}

  /// In [0, 1]: 1 if it stays nonnegative, 0 if it is negative from the beginning.
  double find() const {
    static const std::vector<double> grid = make_grid();
    double before = 0;
    bool positive = false;
    double last = value_at(c_, grid[0]), last_but_one = last;
    for (std::size_t k = 0; k < grid.size(); ++k) {
      const double now = k == 0 ? last : value_at(c_, grid[k]);
      if (now < -noise_) return positive ? root(before, grid[k]) : 0;
      if (k > 1 && positive && last <= last_but_one && last <= now && last < 2 * std::max(last_but_one, now)) {
        const double least = minimum(grid[k - 2], grid[k]);
        if (value_at(c_, least) < -noise_) return root(std::min(before, grid[k - 2]), least);
      }
      positive = positive || now > noise_;
      if (now > noise_) before = grid[k];
      last_but_one = last;
      last = now;
    }
    return 1;
  }

 private:
  static std::vector<double> make_grid() {
    std::vector<double> grid{0};
    for (int k = 24; k > 6; --k) grid.push_back(std::pow(2, -k));
    constexpr int points = 48;
    for (int k = 1; k <= points; ++k) {
      const double s = (1 - std::cos(3.141592653589793 * k / points)) / 2;
      if (s > grid.back()) grid.push_back(k == points ? 1 : s);
    }
    return grid;
  }

  double root(double above, double below) const {
    for (int i = 0; i < 100 && above < below; ++i) {
      const double middle = 0.5 * (above + below);
      if (middle <= above || middle >= below) break;
      (value_at(c_, middle) > 0 ? above : below) = middle;
    }
    return above;
  }

  double minimum(double a, double b) const {
    constexpr double golden = 0.6180339887498949;
    for (int i = 0; i < 45; ++i) {
      const double p = b - golden * (b - a), q = a + golden * (b - a);
      if (value_at(c_, p) < value_at(c_, q))
        b = q;
      else
        a = p;
    }
    return 0.5 * (a + b);
  }

  const Vector& c_;
  double noise_;
};

/// A step in one mode.
struct Step {
  double length = 0, tail = INFINITY;
  Matrix x, y, w, f, g, slope;
  double valid = 0;  ///< part of the step up to which y >= 0 and w >= 0
};

class Events {
 public:
  explicit Events(const EventScene& e) : e_(e), s_(e.scene), n_(s_.M.rows()), m_(s_.A.rows()) {
    for (unsigned set = 0; set < 1u << n_; ++set) modes_.push_back(mode_of(s_, set));
    size_x_ = Vector::Zero(m_);
    size_f_ = Vector::Zero(m_);
    size_g_ = Vector::Zero(n_);
    longest_ = e.longest_step > 0 ? std::min(e.longest_step, s_.T) : s_.T;
    unique_ = is_p();
    monotone_ = Eigen::SelfAdjointEigenSolver<Matrix>(Matrix(s_.M + s_.M.transpose())).eigenvalues().minCoeff() >=
                -1e-12 * s_.M.cwiseAbs().maxCoeff();
  }

  EventSolution solve() {
    // Edges that coincide but for rounding are one: where M = 0, the values between them would be an impulse.
    constexpr double same = 1e-12;
    std::vector<double> ends;
    for (const double b : e_.breaks) {
      if (!ends.empty() && b - ends.back() <= same * s_.T) ends.pop_back();
      ends.push_back(b);
    }
    ends.push_back(s_.T);
    x_ = out_.start = s_.x0;
    integral_ = out_.doubt = Vector::Zero(n_);
    h_ = longest_;
    for (const double end : ends) {
      if (end <= t_) continue;
      end_ = end;
      if (!choose(true) || !run()) return finish(false);
      t_ = end;
    }
    return finish(true);
  }

 private:
  bool is_p() const {
    for (unsigned set = 1; set < 1u << n_; ++set) {
      const std::vector<Index> S = members(set, n_);
      const Matrix block = s_.M(S, S);
      double size = 1;
      for (Index i = 0; i < block.rows(); ++i) size *= block.row(i).cwiseAbs().maxCoeff();
      if (!(block.determinant() > 1e-12 * size)) return false;
    }
    return true;
  }

  EventSolution finish(bool decided) {
    out_.decided = decided;
    out_.until = decided ? s_.T : t_;
    return std::move(out_);
  }

  bool give_up(const std::string& reason) {
    if (out_.reason.empty()) out_.reason = reason + " at t = " + std::to_string(t_);
    return false;
  }

  void sample(double h, Step& step) const {
    const Collocation& c = Collocation::get();
    Matrix f(degree + 1, m_), g(degree + 1, n_);
    for (Index k = 0; k <= degree; ++k) {
      f.row(k) = value(s_.f, t_ + h * c.samples[k], m_).transpose();
      g.row(k) = value(s_.g, t_ + h * c.samples[k], n_).transpose();
    }
    step.f = c.from_samples * f;
    step.g = c.from_samples * g;
    step.slope = c.derivative * step.g / h;
  }

  static double tail(const Matrix& c, const Vector& size) {
    double largest = 0;
    const double floor = 1e-6 * (size.size() > 0 ? size.maxCoeff() : 0) + 1e-280;
    for (Index i = 0; i < c.cols(); ++i)
      largest = std::max(largest, (std::abs(c(degree, i)) + std::abs(c(degree - 1, i))) / std::max(size[i], floor));
    return std::isfinite(largest) ? largest : INFINITY;
  }

  static Vector sizes(const Matrix& c, const Vector& before) {
    return before.cwiseMax((Collocation::get().values * c).cwiseAbs().colwise().maxCoeff().transpose());
  }

  /// The step from here in a mode, without sign checks.
  Step attempt(const Mode& mode, double h) const {
    const Collocation& c = Collocation::get();
    Step step;
    step.length = h;
    sample(h, step);
    const Matrix AS = s_.A + s_.B * mode.y_of_x;
    const Matrix free_y =
        step.f * mode.y_of_f.transpose() + step.g * mode.y_of_g.transpose() + step.slope * mode.y_of_slope.transpose();
    const Matrix drive = (c.values * (step.f + free_y * s_.B.transpose())).bottomRows(degree);
    Matrix matrix = Matrix::Identity(degree * m_, degree * m_);
    for (Index i = 0; i < degree; ++i)
      for (Index j = 0; j < degree; ++j) matrix.block(i * m_, j * m_, m_, m_) -= h * c.runge_kutta(i, j) * AS;
    const Matrix from = (h * (c.runge_kutta * drive)).rowwise() + x_.transpose();
    const RowMatrix right = from;
    const Vector X = matrix.partialPivLu().solve(Eigen::Map<const Vector>(right.data(), degree * m_));
    Matrix values(degree + 1, m_);
    values.row(0) = x_.transpose();
    values.bottomRows(degree) = Eigen::Map<const RowMatrix>(X.data(), degree, m_);
    step.x = c.coefficients * values;
    step.y = step.x * mode.y_of_x.transpose() + free_y;
    step.w = step.x * s_.N.transpose() + step.y * s_.M.transpose() + step.g;
    step.tail = std::max({tail(step.x, sizes(step.x, size_x_)), tail(step.f, sizes(step.f, size_f_)),
                          n_ > 0 ? tail(step.g, sizes(step.g, size_g_)) : 0});
    return step;
  }

  /// Fraction of the step over which y >= 0 and w >= 0.
  double validity(const Mode& mode, const Step& step) const {
    const Vector x = sizes(step.x, size_x_), f = sizes(step.f, size_f_), g = sizes(step.g, size_g_);
    const Vector slope = sizes(step.slope, Vector::Zero(n_));
    const Vector y = mode.y_of_x.cwiseAbs() * x + mode.y_of_f.cwiseAbs() * f + mode.y_of_g.cwiseAbs() * g +
                     mode.y_of_slope.cwiseAbs() * slope;
    const Vector w = s_.N.cwiseAbs() * x + s_.M.cwiseAbs() * y + g;
    if (mode.constraint_x.rows() > 0) {
      const Vector start = g_right(step);
      const Vector off = mode.constraint_x * x_ + mode.constraint_g * start;
      const Vector size = mode.constraint_x.cwiseAbs() * x + mode.constraint_g.cwiseAbs() * g;
      if ((off.cwiseAbs() - 10 * noise_level * size).maxCoeff() > 0) return 0;
    }
    double valid = 1;
    for (Index i = 0; i < n_ && valid > 0; ++i) {
      const bool active = mode.set >> i & 1u;
      const Vector c = active ? step.y.col(i) : step.w.col(i);
      const double noise = noise_level * (active ? y[i] : w[i]) + 1e-290;
      valid = std::min(valid, SignChange(c, noise).find());
    }
    return valid;
  }

  static Vector g_right(const Step& step) { return step.g.transpose() * legendre(0); }

  /// The longest resolved step in a mode, with its validity.
  std::optional<Step> step_in(const Mode& mode, double h) const {
    h = std::min({h, longest_, end_ - t_});
    double before = INFINITY;
    for (int k = 0; k < 60; ++k) {
      Step step = attempt(mode, h);
      // Only rounding is left if a shorter step does not help: t has a rounding error of 1e-16, so sin(1e5 t) has
      // 1e-11.
      const bool rounding = step.tail <= noise_level && step.tail > 0.5 * before;
      if (step.tail <= resolved || rounding || h < 1e-14 * s_.T) {
        step.valid = validity(mode, step);
        return step;
      }
      before = step.tail;
      h *= std::isfinite(step.tail) ? std::clamp(0.9 * std::pow(resolved / step.tail, 0.11), 0.1, 0.7) : 0.1;
    }
    return std::nullopt;
  }

  static Vector state(const Step& step, double s) { return step.x.transpose() * legendre(s); }

  bool same(const Vector& a, const Vector& b, const Vector& size) const {
    const double floor = 1e-3 * size.maxCoeff() + 1e-290;
    for (Index i = 0; i < a.size(); ++i)
      if (!(std::abs(a[i] - b[i]) <= same_state * std::max(size[i], floor))) return false;
    return true;
  }

  /// Tries all modes that can continue from here and takes the longest. False if two of them lead to different states.
  bool choose_among_all(double h, bool& found) {
    std::vector<std::pair<unsigned, Step>> candidates;
    for (const auto& mode : modes_)
      if (mode)
        if (auto step = step_in(*mode, h); step && step->valid > 0) candidates.emplace_back(mode->set, *step);
    found = !candidates.empty();
    if (!found) return true;
    const auto lasts = [](const Step& s) { return s.valid * s.length; };
    std::size_t best = 0;
    for (std::size_t i = 1; i < candidates.size(); ++i)
      if (lasts(candidates[i].second) > lasts(candidates[best].second)) best = i;
    const Step& main = candidates[best].second;
    const Vector size = sizes(main.x, size_x_);
    const Vector size_y = sizes(main.y, size_y_.size() > 0 ? size_y_ : Vector(Vector::Zero(n_)));
    for (const auto& [set, step] : candidates) {
      const double common = std::min(lasts(step), lasts(main));
      if (set == candidates[best].first || common < 1e-3 * lasts(main)) continue;
      if (!same(state(step, common / step.length), state(main, common / main.length), size))
        return give_up("the solution is not unique");
      const Vector P = legendre(0.5 * common / step.length), Q = legendre(0.5 * common / main.length);
      if (!same(step.y.transpose() * P, main.y.transpose() * Q, size_y)) out_.y_unique = false;
    }
    set_ = candidates[best].first;
    return true;
  }

  bool jump() {
    Step step;
    double h = std::min(h_, end_ - t_);
    for (sample(h, step); tail(step.g, sizes(step.g, size_g_)) > resolved && h > 1e-14 * s_.T; sample(h, step)) h /= 2;
    const Vector g = g_right(step);
    const Vector noise =
        10 * noise_level * (s_.N.cwiseAbs() * x_.cwiseAbs().cwiseMax(size_x_) + g.cwiseAbs().cwiseMax(size_g_));
    const std::vector<Jump> jumps = jumps_from(s_, x_, g, noise);
    if (jumps.empty()) return give_up("no active set and no jump continues the solution");
    for (const Jump& other : jumps)
      if (!same(other.x, jumps.front().x, size_x_.cwiseMax(jumps.front().x.cwiseAbs())))
        return give_up("the jump of the state is not unique");
    const Vector size_p = Vector::Constant(n_, jumps.front().p.cwiseAbs().maxCoeff());
    for (const Jump& other : jumps)
      if (!same(other.p, jumps.front().p, size_p)) out_.y_unique = false;
    x_ = jumps.front().x;
    integral_ += jumps.front().p;
    ++out_.jumps;
    size_x_ = size_x_.cwiseMax(x_.cwiseAbs());
    return true;
  }

  bool choose(bool may_jump) {
    size_x_ = size_x_.cwiseMax(x_.cwiseAbs());
    if (unique_ && modes_[set_])
      if (const auto step = step_in(*modes_[set_], h_); step && step->valid > 0) return true;
    bool found = false;
    double h = h_;
    for (int k = 0; k < 7 && !found; ++k, h *= 0.1)
      if (!choose_among_all(h, found)) return false;
    if (found) return true;
    if (!may_jump || !monotone_) return give_up("no active set continues the solution");
    if (!jump()) return false;
    return choose(false);
  }

  /// Where a negative w_i counts as zero, y_i may be -w_i / M_ii in truth; a negative y_i may be 0.
  void doubt(const Step& step) {
    constexpr int looks = 16;
    for (Index i = 0; i < n_; ++i) {
      const bool active = set_ >> i & 1u;
      if (!active && !(s_.M(i, i) > 0)) continue;
      const Vector c = active ? step.y.col(i) : step.w.col(i);
      for (int k = 0; k <= looks; ++k)
        out_.doubt[i] = std::max(out_.doubt[i], -value_at(c, step.valid * k / looks) / (active ? 1 : s_.M(i, i)));
    }
  }

  void accept(const Step& step) {
    doubt(step);
    const double end = step.valid >= 1 ? t_ + step.length : t_ + step.valid * step.length;
    const double to = end_ - end < 1e-15 * s_.T ? end_ : end;
    out_.pieces.push_back({t_, step.length, to, set_, step.x, step.y, integral_});
    size_x_ = sizes(step.x, size_x_);
    size_f_ = sizes(step.f, size_f_);
    size_g_ = sizes(step.g, size_g_);
    size_y_ = sizes(step.y, size_y_.size() > 0 ? size_y_ : Vector(Vector::Zero(n_)));
    x_ = state(step, step.valid);
    integral_ += step.length * (step.y.transpose() * legendre_integrals(step.valid));
    t_ = to;
  }

  /// Runs up to end_.
  bool run() {
    int idle = 0;  // consecutive events without progress in time
    for (long k = 0; t_ < end_; ++k) {
      if (long(out_.pieces.size()) > most_pieces) return give_up("too many steps");
      const bool look = !unique_ && !monotone_ && k % 4 == 3;
      if (look && !choose(true)) return false;
      const auto step = step_in(*modes_[set_], h_);
      if (!step) return give_up("a step could not be resolved");
      if (!x_.allFinite() || !step->x.allFinite()) return give_up("the solution grows without bounds");
      const double before = t_;
      if (step->valid > 0) accept(*step);
      if (step->valid >= 1) {
        const double room = step->tail > 0 ? std::pow(resolved / step->tail, 0.11) : 3;
        h_ = step->length * std::clamp(0.9 * room, 1.0, 3.0);
        if (end_ - t_ > 0 && end_ - t_ < 1e-14 * s_.T) t_ = end_;
        continue;
      }
      idle = t_ - before > 1e-13 * s_.T ? 0 : idle + 1;
      if (++out_.events > most_events || idle > 40) return give_up("events accumulate");
      if (t_ < end_ && !choose(true)) return false;
    }
    return true;
  }

  const EventScene& e_;
  const DenseScene& s_;
  Index n_, m_;
  std::vector<std::optional<Mode>> modes_;
  double longest_, t_ = 0, end_ = 0, h_ = 0;
  unsigned set_ = 0;
  bool unique_ = false, monotone_ = false;
  Vector x_, integral_, size_x_, size_f_, size_g_, size_y_;
  EventSolution out_;
};

}  // namespace

EventSolution locate_events(const EventScene& scene) { return Events(scene).solve(); }

}  // namespace bromwich::oracle
