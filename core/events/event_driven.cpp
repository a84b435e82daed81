#include "core/events/event_driven.hpp"

#include "core/base/text.hpp"
#include "core/events/collocation.hpp"
#include "core/lcp/active_set.hpp"
#include "core/lcp/lcp_class.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

namespace bromwich {

namespace {

constexpr Index most_states = 64, most_constraints = 48;
constexpr double noise_share = 10;           ///< of the tolerance: negative values below count as zero
constexpr double shortest_share = 1e-14;     ///< of T
constexpr Index looks_per_interval = 16384;  ///< at sources, in [0, T], where they seem to be smooth
constexpr double overhead = 4000;            ///< of a step, in the time of floating-point operations
constexpr double rounding_defect = 3e-13;
constexpr int most_jumps_at_once = 12;
constexpr int idle_events = 40;      ///< events within a short time that count as accumulated
constexpr double idle_share = 1e-7;  ///< of T: that time
constexpr int most_accumulations = 200;
constexpr std::size_t most_stored = 60000000;  ///< numbers in the pieces

// f and g as polynomials on a step.
class EventSources {
  static constexpr Index s = Collocation::degree;

 public:
  explicit EventSources(const Scene& scene) : scene_(scene), m_(scene.states()), n_(scene.constraints()) {
    if (scene.f && scene.f_entry != SourceEntry::state)
      F_ = source_matrix(scene, get<DenseDynamics>(scene.dynamics));
  }

  bool any() const { return bool(scene_.f) || bool(scene_.g); }

  Vector f(double t) const {
    if (!scene_.f) return Vector::Zero(m_);
    Vector phi = Vector::Zero(scene_.sources());
    scene_.f(t, phi);
    return F_.size() > 0 ? Vector(F_ * phi) : phi;
  }

  Vector g(double t) const {
    Vector v = Vector::Zero(n_);
    if (scene_.g) scene_.g(t, v);
    return v;
  }

  // How far the polynomials of sources on [t, t + h] are from the sources at `count` times. A pulse may lie between the
  // times that a polynomial is made from.
  void look(double t, double h, Index count, const Matrix& f_coefficients, const Matrix& g_coefficients, Vector& off_f,
            Vector& off_g) const {
    constexpr double golden = 0.6180339887498949;
    for (Index k = 0; k < count; ++k) {
      const double irregular = golden * double(k) - std::floor(golden * double(k));
      const double at = (double(k) + 0.1 + 0.8 * irregular) / double(count);
      const Vector p = legendre(at);
      if (scene_.f) off_f = off_f.cwiseMax((f(t + h * at) - f_coefficients.transpose() * p).cwiseAbs());
      if (scene_.g) off_g = off_g.cwiseMax((g(t + h * at) - g_coefficients.transpose() * p).cwiseAbs());
    }
  }

  // Coefficients of f (s+1 x m) and g (s+1 x n) on [t, t + h], and how far they are from the sources at further points.
  void sample(double t, double h, Matrix& f_coefficients, Matrix& g_coefficients, Vector& off_f, Vector& off_g) const {
    const Collocation& c = Collocation::get();
    const auto one = [&](bool given, Index width, const auto& value, Matrix& coefficients, Vector& off) {
      off = Vector::Zero(width);
      if (!given) return coefficients.setZero(s + 1, width), void();
      Matrix values(s + 1, width);
      for (Index k = 0; k <= s; ++k) values.row(k) = value(t + h * c.samples[k]).transpose();
      coefficients = c.from_samples * values;
      const Matrix expected = c.at_checks * coefficients;
      for (Index k = 0; k < c.checks.size(); ++k)
        off = off.cwiseMax((value(t + h * c.checks[k]) - expected.row(k).transpose()).cwiseAbs());
    };
    one(
        bool(scene_.f), m_, [this](double at) { return f(at); }, f_coefficients, off_f);
    one(
        bool(scene_.g), n_, [this](double at) { return g(at); }, g_coefficients, off_g);
  }

 private:
  const Scene& scene_;
  Index m_, n_;
  Matrix F_;
};

// A step in one mode: polynomials, valid on the first `valid` of it.
struct EventStep {
  double length = 0, defect = INFINITY, valid = 0;
  Matrix x, y, w;
  Matrix f, df, g, dg, ddg;
};

// Largest absolute values of each component so far.
struct EventSizes {
  JetValues u;

  void include(const EventStep& step) { u = with(step); }
  JetValues with(const EventStep& step) const {
    return {larger(u.x, step.x), larger(u.f, step.f),   larger(u.df, step.df),
            larger(u.g, step.g), larger(u.dg, step.dg), larger(u.ddg, step.ddg)};
  }

 private:
  // Coefficients of Legendre polynomials bound the values.
  static Vector larger(const Vector& before, const Matrix& c) {
    if (c.size() == 0) return before;
    return before.cwiseMax(c.cwiseAbs().colwise().sum().transpose());
  }
};

class EventIntegration {
  static constexpr Index s = Collocation::degree;
  using Step = EventStep;

 public:
  EventIntegration(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                   const EventOptions& o)
      : scene_(scene), breakpoints_(breakpoints), options_(o), sources_(scene), class_(lcp_class), T_(scene.T) {
    const DenseDynamics& d = get<DenseDynamics>(scene.dynamics);
    system_ = {d.A, d.B, d.N, to_dense(scene.M)};
    m_ = system_.states();
    n_ = system_.constraints();
    longest_ = o.longest_step > 0 ? o.longest_step : T_ / 64;
    const Vector of_x = Vector::Zero(m_), of_y = Vector::Zero(n_);
    sizes_.u = {of_x, of_x, of_x, of_y, of_y, of_y};
    x_ = scene.x0;
    y_ = integral_ = of_y;
  }

  EventSolution run() {
    if (!determines_y()) return ended("the complementarity problem of a short step is not of class P");
    std::vector<double> ends;
    for (const double t : breakpoints_)
      if (t > 0 && t < T_) ends.push_back(t);
    solution_.breakpoints = Index(ends.size());
    ends.push_back(T_);
    h_ = longest_;
    for (const double end : ends) {
      end_ = end;
      if (end_ - t_ <= 4 * epsilon * T_) {  // edges that differ by rounding alone
        t_ = end_;
        continue;
      }
      if (!begin_segment() || !run_segment()) return ended("");
    }
    solution_.complete = true;
    return ended("");
  }

 private:
  EventSolution ended(const std::string& reason) {
    if (solution_.reason.empty()) solution_.reason = reason;
    solution_.until = t_;
    return std::move(solution_);
  }

  bool give_up(const std::string& why) {
    solution_.reason = why + text(" at t = %.6g", t_);
    return false;
  }

  bool determines_y() {
    if (n_ == 0 || class_ == LcpClass::P) return true;
    if (!is_PSD(LcpMatrix(system_.M))) return false;
    const double rate = std::max(1 / T_, system_.A.cwiseAbs().rowwise().sum().maxCoeff());
    for (const double share : {1e-2, 1e-5}) {
      const Matrix W = step_matrix(share / rate);
      const LcpClass found = classify(LcpMatrix(W));
      step_class_ = found;
      if (found == LcpClass::P) continue;
      if (!is_PSD(LcpMatrix(W)) || moves_the_state(W)) return false;
      step_class_ = LcpClass::PSD;
    }
    return true;
  }

  // Whether two solutions of a monotone problem with the matrix W may have different B y: their difference lies in the
  // null space of W + W^T.
  bool moves_the_state(const Matrix& W) const {
    const Vector by = W.diagonal().cwiseAbs().cwiseMax(1e-290).cwiseSqrt().cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<Matrix> solver(by.asDiagonal() * Matrix(W + W.transpose()) * by.asDiagonal());
    const Matrix B = system_.B * by.asDiagonal();
    for (Index k = 0; k < n_; ++k)
      if (solver.eigenvalues()[k] < 1e-9 * solver.eigenvalues()[n_ - 1] &&
          (B * solver.eigenvectors().col(k)).cwiseAbs().maxCoeff() > 1e-7 * B.cwiseAbs().maxCoeff())
        return true;
    return false;
  }

  // M + h N (I - hA)^{-1} B.
  Matrix step_matrix(double h) const {
    const Matrix shifted = Matrix::Identity(m_, m_) - h * system_.A;
    return system_.M + h * (system_.N * shifted.partialPivLu().solve(system_.B));
  }

  const Mode* mode_of(const std::vector<Index>& active) {
    auto known = modes_.find(active);
    if (known == modes_.end()) known = modes_.emplace(active, make_mode(system_, active)).first;
    return known->second ? &*known->second : nullptr;
  }

  // one step

  void sample(double h, const Mode& mode, Step& step, Vector& off_f, Vector& off_g) const {
    const Collocation& c = Collocation::get();
    sources_.sample(t_, h, step.f, step.g, off_f, off_g);
    if (mode.uses_df) step.df = c.derivative * step.f / h;
    if (mode.uses_dg) step.dg = c.derivative * step.g / h;
    if (mode.uses_ddg) step.ddg = c.derivative * (c.derivative * step.g) / (h * h);
  }

  // Coefficients of the part of rows of a jet that does not depend on x.
  static Matrix without_x(const Jet& rows, const Step& p) {
    Matrix sum = p.f * rows.f.transpose() + p.g * rows.g.transpose();
    if (p.df.size() > 0) sum += p.df * rows.df.transpose();
    if (p.dg.size() > 0) sum += p.dg * rows.dg.transpose();
    if (p.ddg.size() > 0) sum += p.ddg * rows.ddg.transpose();
    return sum;
  }

  // (I - h lambda A_S) for the eigenvalues lambda of the Radau matrix, kept as long as mode and h stay.
  const std::vector<Eigen::PartialPivLU<ComplexMatrix>>& factors(const Mode& mode, double h) {
    if (factored_mode_ == &mode && factored_h_ == h) return factors_;
    factors_.clear();
    const ComplexMatrix identity = ComplexMatrix::Identity(m_, m_);
    for (const auto& e : Collocation::get().eigenvalues)
      factors_.emplace_back(identity - (h * e.value) * mode.A.cast<Complex>());
    factored_mode_ = &mode;
    factored_h_ = h;
    work_ += 12 * double(m_ * m_ * m_);
    return factors_;
  }

  Step attempt(const Mode& mode, double h) {
    const Collocation& c = Collocation::get();
    Step step;
    step.length = h;
    Vector off_f, off_g;
    sample(h, mode, step, off_f, off_g);
    const Matrix y_of_sources = without_x(mode.y, step);
    const Matrix input = step.f + y_of_sources * system_.B.transpose();
    const Matrix right = (h * (c.integrals * input)).rowwise() + x_.transpose();  // s x m
    Matrix values = Matrix::Zero(s + 1, m_);
    values.row(0) = x_.transpose();
    const auto& lu = factors(mode, h);
    for (std::size_t k = 0; k < lu.size(); ++k) {
      const auto& e = c.eigenvalues[k];
      const ComplexVector z = lu[k].solve(ComplexVector(right.transpose().cast<Complex>() * e.left));
      values.bottomRows(s) += e.weight * (e.right * z.transpose()).real();
    }
    step.x = c.coefficients * values;
    step.y = step.x * mode.y.x.transpose() + y_of_sources;
    step.w = step.x * system_.N.transpose() + step.y * system_.M.transpose() + step.g;
    const JetValues size = sizes_.with(step);
    step.defect = std::max({tail(step.x, size.x, {}), tail(step.f, size.f, off_f), tail(step.g, size.g, off_g)});
    work_ +=
        double((s + 1) * (s + 1) * (3 * m_ + 3 * n_) + 40 * m_ * m_ + (s + 1) * (4 * m_ * n_ + 2 * n_ * n_)) + overhead;
    return step;
  }

  // The last two coefficients, or a difference that was seen, relative to the sizes.
  static double tail(const Matrix& c, const Vector& size, const Vector& off) {
    if (size.size() == 0) return 0;
    const double floor = 1e-4 * size.maxCoeff() + 1e-280;
    double largest = 0;
    for (Index i = 0; i < c.cols(); ++i) {
      const double last = std::abs(c(s, i)) + std::abs(c(s - 1, i)), seen = off.size() > 0 ? off[i] : 0;
      largest = std::max(largest, std::max(last, seen) / std::max(size[i], floor));
    }
    return std::isfinite(largest) ? largest : INFINITY;
  }

  double noise() const { return noise_share * options_.tolerance; }

  // The part of the step on which y and w are nonnegative; which component ends it is left in `event_`.
  double validity(const Mode& mode, const Step& step) {
    const Collocation& c = Collocation::get();
    const JetValues size = sizes_.with(step);
    const Vector of_y = terms(mode.y, size);
    const Vector of_w = system_.N.cwiseAbs() * size.x + system_.M.cwiseAbs() * of_y + size.g;
    double valid = 1;
    event_ = -1;
    Vector of_event;
    std::size_t k = 0;
    for (Index i = 0; i < n_; ++i) {
      const bool active = k < mode.active.size() && mode.active[k] == i;
      if (active) ++k;
      const double zero = noise() * (active ? of_y[i] : of_w[i]) + 1e-290;
      const Vector coefficients = (active ? step.y : step.w).col(i);
      const double at = first_below(c.bernstein * coefficients, zero);
      if (at >= valid) continue;
      valid = at;
      event_ = i;
      of_event = coefficients;
    }
    if (event_ >= 0 && valid > 0) valid = zero_before(of_event, valid);
    return valid;
  }

  // Looks at the sources at more times of a long step.
  void look_between(Step& step) const {
    const Index count = Index(double(looks_per_interval) * step.length / T_);
    if (count <= Collocation::get().checks.size() || !sources_.any()) return;
    Vector off_f = Vector::Zero(m_), off_g = Vector::Zero(n_);
    sources_.look(t_, step.length, count, step.f, step.g, off_f, off_g);
    const JetValues size = sizes_.with(step);
    step.defect = std::max({step.defect, tail(step.f, size.f, off_f), tail(step.g, size.g, off_g)});
  }

  // The longest resolved step in a mode, with its validity. False if none is.
  bool resolve(const Mode& mode, double h, Step& step) {
    h = std::min({h, longest_, end_ - t_});
    double before = INFINITY;
    shortened_ = false;
    for (int k = 0; k < 80; ++k) {
      step = attempt(mode, h);
      // Where a shorter step does not help, rounding is left: t is known to 1e-16, and sin(1e5 t) to 1e-11.
      const bool rounding = step.defect <= 1e3 * options_.tolerance && step.defect > 0.5 * before;
      if (step.defect <= options_.tolerance) look_between(step);
      if (step.defect <= options_.tolerance || rounding) {
        step.valid = validity(mode, step);
        return true;
      }
      if (h < shortest_share * T_) return false;
      before = step.defect;
      shortened_ = true;
      h *= std::isfinite(step.defect)
               ? std::clamp(0.9 * std::pow(options_.tolerance / step.defect, 1.0 / double(s)), 0.1, 0.7)
               : 0.1;
    }
    return false;
  }

  // which active set continues

  // What w lacks to 0 on constraints that the state touches: rounding, and the error of the time of the event.
  Vector touching(bool y_is_known) const {
    const Vector g = sources_.g(t_ + 1e-15 * T_);
    const Vector w = system_.N * x_ + system_.M * y_ + g;
    const Vector of_w = system_.N.cwiseAbs() * sizes_.u.x.cwiseMax(x_.cwiseAbs()) +
                        system_.M.cwiseAbs() * y_.cwiseAbs() + sizes_.u.g.cwiseMax(g.cwiseAbs());
    Vector offset = Vector::Zero(n_);
    for (Index i = 0; i < n_; ++i) {
      const bool depends = system_.M.row(i).cwiseAbs().maxCoeff() > 0;
      if ((!depends || y_is_known) && std::abs(w[i]) <= 10 * noise() * of_w[i]) offset[i] = w[i];
    }
    return offset;
  }

  struct EulerStep {
    bool solved = false;
    Vector y, x;
  };

  EulerStep euler(double h, const Vector& offset) {
    const Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(m_, m_) - h * system_.A);
    const Matrix moved = h * lu.solve(system_.B);
    const Vector free = lu.solve(x_ + h * sources_.f(t_ + h));
    const Vector q = system_.N * free + sources_.g(t_ + h) - offset;
    EulerStep step;
    ActiveSetLcp lcp(system_.M + system_.N * moved, step_class_);
    step.solved = lcp.solve(q, step.y).solved;
    if (step.solved) step.x = free + moved * step.y;
    work_ += double(m_ * m_ * m_ + n_ * n_ * n_);
    return step;
  }

  static std::vector<Index> support(const Vector& y) {
    std::vector<Index> set;
    for (Index i = 0; i < y.size(); ++i)
      if (y[i] > 0) set.push_back(i);
    return set;
  }

  enum class Entry { smooth, jumped, refused };

  // An impulse is what h y tends to in steps of implicit Euler as h -> 0: that selects the one that the state needs.
  bool is_limit_of_short_steps(const Vector& p) {
    const double h = 1e-8 / std::max(1 / T_, system_.A.cwiseAbs().rowwise().sum().maxCoeff());
    const EulerStep step = euler(std::min(h, 0.5 * (end_ - t_)), touching(false));
    if (!step.solved) return false;
    const Vector moved = system_.B * p, by_step = step.x - x_;
    return (moved - by_step).cwiseAbs().maxCoeff() <=
           1e-3 * moved.cwiseAbs().maxCoeff() + 100 * noise() * x_.cwiseAbs().maxCoeff();
  }

  // Brings the state onto the constraints of the mode by an impulse.
  Entry enter(const Mode& mode) {
    if (mode.constraints.x.rows() == 0) return Entry::smooth;
    Step here;  // only to have f and g at t
    Vector off_f, off_g;
    const double h = std::min({h_, longest_, end_ - t_}) / 16;
    sample(h, mode, here, off_f, off_g);
    const Vector at = legendre(0);
    const auto start = [&](const Matrix& c, Index width) {
      return c.size() > 0 ? Vector(c.transpose() * at) : Vector(Vector::Zero(width));
    };
    const Collocation& c = Collocation::get();
    const JetValues u{x_,
                      start(here.f, m_),
                      start(here.df, m_),
                      start(here.g, n_),
                      Vector(c.derivative.transpose().size() > 0 ? Vector((c.derivative * here.g / h).transpose() * at)
                                                                 : Vector(Vector::Zero(n_))),
                      start(here.ddg, n_)};
    const Vector off = evaluate(mode.constraints, u);
    JetValues size = sizes_.u;
    size.x = size.x.cwiseMax(x_.cwiseAbs());
    size.f = size.f.cwiseMax(u.f.cwiseAbs());
    size.g = size.g.cwiseMax(u.g.cwiseAbs());
    size.dg = size.dg.cwiseMax(u.dg.cwiseAbs());
    const Vector of = terms(mode.constraints, size);
    const Vector p = mode.impulse * off;
    const Vector moved = system_.B * p;
    const bool jumps = ((off.cwiseAbs() - 30 * noise() * of).array() > 0).any();
    if (jumps) {
      // What no impulse moves has to hold.
      JetValues after = u;
      after.x += moved;
      const Vector left = evaluate(mode.constraints, after);
      if (((left.cwiseAbs() - 100 * noise() * of).array() > 0).any()) return Entry::refused;
      if (p.minCoeff() < -1e-6 * p.cwiseAbs().maxCoeff()) return Entry::refused;
      // An impulse of w has to be nonnegative, too.
      const Vector of_w = system_.M * p, terms_of_w = system_.M.cwiseAbs() * p.cwiseAbs();
      if (((of_w + 1e-6 * terms_of_w).array() < 0).any()) return Entry::refused;
      if (!is_limit_of_short_steps(p)) return Entry::refused;
    }
    x_ += moved;
    integral_ += p;
    if (!jumps) return Entry::smooth;
    if (t_ == 0) {
      if (solution_.jump_at_start.size() == 0) solution_.jump_at_start = Vector::Zero(n_);
      solution_.jump_at_start += p;
    } else {
      solution_.continuous = false;
    }
    ++solution_.jumps;
    sizes_.u.x = sizes_.u.x.cwiseMax(x_.cwiseAbs());
    return Entry::jumped;
  }

  // Tries an active set from here. The step is kept if it lasts.
  Entry try_set(const std::vector<Index>& set, double least, Step& step, bool& found) {
    found = false;
    const Mode* mode = mode_of(set);
    if (!mode) return Entry::refused;
    const Vector x = x_, integral = integral_;
    const Entry entry = enter(*mode);
    if (entry != Entry::smooth) return entry;
    Step next;
    if (resolve(*mode, h_, next)) {
      const double lasts = next.valid * next.length;
      found = next.valid >= 1 || lasts >= least;
      if (found || lasts > best_.lasts) best_ = {mode, lasts, next, event_, x_, integral_};
    }
    if (found)
      take_best(step);
    else
      x_ = x, integral_ = integral;
    return entry;
  }

  // The candidate that lasted longest so far.
  struct Candidate {
    const Mode* mode = nullptr;
    double lasts = 0;
    Step step = {};
    Index event = -1;
    Vector x = {}, integral = {};
  };

  void take_best(Step& step) {
    mode_ = best_.mode;
    step = std::move(best_.step);
    event_ = best_.event;
    x_ = std::move(best_.x);
    integral_ = std::move(best_.integral);
  }

  // Tries the active sets that short steps of implicit Euler propose.
  Entry try_proposed(double h, const Vector& offset, std::set<std::vector<Index>>& tried, Step& step, bool& found) {
    static constexpr std::array<double, 6> shares{1e-3, 1e-5, 1e-2, 1e-7, 1e-1, 1e-9};
    for (const double share : shares) {
      const EulerStep proposed = euler(share * h, offset);
      if (!proposed.solved || !proposed.y.allFinite()) continue;
      const std::vector<Index> set = support(proposed.y);
      if (!tried.insert(set).second) continue;
      const Entry entry = try_set(set, 0.5 * share * h, step, found);
      if (found || entry == Entry::jumped) return entry;
    }
    return Entry::refused;
  }

  // The active set that continues from here, and its first step. `likely`: tried first; empty: none. `known`: y_ is the
  // limit of y from the left.
  bool choose(Step& step, bool known, const std::optional<std::vector<Index>>& likely) {
    sizes_.u.x = sizes_.u.x.cwiseMax(x_.cwiseAbs());
    for (int jumps = 0; jumps <= most_jumps_at_once; ++jumps) {
      const double h = std::min({h_, longest_, end_ - t_});
      best_ = {};
      std::set<std::vector<Index>> tried;
      bool found = false;
      Entry entry = Entry::refused;
      if (likely && jumps == 0) {
        tried.insert(*likely);
        entry = try_set(*likely, 1e-3 * h, step, found);
      }
      if (!found && entry != Entry::jumped) entry = try_proposed(h, touching(known), tried, step, found);
      if (found) return true;
      known = false;
      if (entry == Entry::jumped) continue;
      // None lasts: the next event is very near.
      if (!(best_.lasts > 4 * epsilon * T_)) return false;
      take_best(step);
      return true;
    }
    return false;
  }

  // the way through time

  bool begin_segment() {
    Step step;
    const Vector before = y_;
    const bool first = t_ == 0;
    std::optional<std::vector<Index>> likely;
    if (mode_) likely = mode_->active;
    if (!choose(step, false, likely)) return give_up("no active set was found that continues the solution");
    if (!first) note_jump_of_y(before, step);
    const Index next = event_;
    accept(step);
    pending_event_ = step.valid < 1 ? next : -1;
    return true;
  }

  // y_ from the left and the first value of the next step.
  void note_jump_of_y(const Vector& before, const Step& step) {
    if (n_ == 0) return;
    const Vector after = step.y.transpose() * legendre(0);
    const double size = std::max(size_y_, after.cwiseAbs().maxCoeff());
    if ((after - before).cwiseAbs().maxCoeff() > 1e-6 * size) solution_.continuous = false;
  }

  void accept(const Step& step) {
    const double end = step.valid >= 1 ? t_ + step.length : t_ + step.valid * step.length;
    const double to = end_ - end < 4 * epsilon * T_ ? end_ : end;
    solution_.pieces.push_back({t_, step.length, to, step.x, step.y, integral_});
    stored_ += std::size_t((s + 1) * (m_ + n_));
    sizes_.include(step);
    solution_.defect = std::max(solution_.defect, step.defect);
    const Vector at = legendre(step.valid);
    x_ = step.x.transpose() * at;
    y_ = step.y.transpose() * at;
    size_y_ = std::max(size_y_, step.y.cwiseAbs().colwise().sum().maxCoeff());
    integral_ += step.length * (step.y.transpose() * legendre_integrals(step.valid));
    t_ = to;
    if (step.valid < 1) return;
    // Rounding makes defects that say nothing of the step.
    const double room =
        step.defect > rounding_defect ? 0.9 * std::pow(options_.tolerance / step.defect, 1.0 / double(s)) : 3;
    if (room > 1.3)
      h_ = std::min(longest_, std::max(h_, step.length * std::min(room, 3.0)));
    else if (shortened_)
      h_ = step.length;
  }

  // The present active set without the component of the event, or with it.
  std::vector<Index> exchanged(Index i) const {
    std::vector<Index> set = mode_->active;
    const auto place = std::lower_bound(set.begin(), set.end(), i);
    if (place != set.end() && *place == i)
      set.erase(place);
    else
      set.insert(place, i);
    return set;
  }

  // A short step of implicit Euler, where events accumulate.
  bool pass_accumulation() {
    if (++solution_.accumulations > most_accumulations) return give_up("events accumulate");
    const double h = std::min(10 * options_.tolerance * T_, 0.5 * (end_ - t_));
    const EulerStep step = euler(h, Vector::Zero(n_));
    if (!step.solved) return give_up("events accumulate");
    EventPiece piece{t_, h, t_ + h, Matrix::Zero(s + 1, m_), Matrix::Zero(s + 1, n_), integral_};
    piece.x.row(0) = (x_ + step.x).transpose() / 2;
    piece.x.row(1) = (step.x - x_).transpose() / 2;
    piece.y.row(0) = step.y.transpose();
    solution_.pieces.push_back(piece);
    x_ = step.x;
    y_ = step.y;
    integral_ += h * step.y;
    t_ += h;
    return true;
  }

  bool may_go_on(long step) {
    if (work_ > options_.most_work || stored_ > most_stored) return give_up(out_of_work);
    if (step % 64 != 0) return true;
    if (options_.progress) options_.progress(t_);
    if (!options_.interrupted || !options_.interrupted()) return true;
    solution_.interrupted = true;
    return give_up("stopped on request");
  }

  bool run_segment() {
    int idle = 0;
    double idle_since = t_;
    for (long k = 0; t_ < end_; ++k) {
      if (!may_go_on(k)) return false;
      if (!x_.allFinite()) return give_up("the solution grows without bounds");
      Step step;
      if (pending_event_ < 0) {
        if (!resolve(*mode_, h_, step)) return give_up("a step could not be resolved");
        if (step.valid > 0) accept(step);
        if (step.valid >= 1) continue;
        pending_event_ = event_;
      }
      if (!(t_ < end_)) break;
      ++solution_.events;
      idle = t_ - idle_since > idle_share * T_ ? 0 : idle + 1;
      if (idle == 0) idle_since = t_;
      const Vector before = y_;
      if (idle > idle_events) {
        idle = 0;
        if (!pass_accumulation()) return false;
      }
      const std::vector<Index> likely = exchanged(pending_event_);
      pending_event_ = -1;
      if (!choose(step, true, likely)) return give_up("no active set was found that continues the solution");
      note_jump_of_y(before, step);
      const Index next = event_;
      accept(step);
      if (step.valid < 1) pending_event_ = next;
    }
    return true;
  }

  const Scene& scene_;
  const std::vector<double>& breakpoints_;
  const EventOptions& options_;
  const EventSources sources_;
  LcpClass class_;
  LcpClass step_class_ = LcpClass::P;  ///< of the matrix of a short step
  double T_, longest_ = 0;
  DenseSystem system_;
  Index m_ = 0, n_ = 0;
  std::map<std::vector<Index>, std::optional<Mode>> modes_;
  const Mode* mode_ = nullptr;
  std::vector<Eigen::PartialPivLU<ComplexMatrix>> factors_;
  const Mode* factored_mode_ = nullptr;
  double factored_h_ = 0;
  double t_ = 0, end_ = 0, h_ = 0, work_ = 0, size_y_ = 0;
  std::size_t stored_ = 0;
  Index event_ = -1, pending_event_ = -1;
  bool shortened_ = false;  ///< the last step that was resolved is shorter than proposed
  Vector x_, y_, integral_;
  EventSizes sizes_;
  Candidate best_;
  EventSolution solution_;
};

}  // namespace

std::string unsuited_to_events(const Scene& scene) {
  const DenseDynamics* d = get_if<DenseDynamics>(&scene.dynamics);
  if (scene.boundary) return "it needs initial values, and the scene has boundary values";
  if (!d || d->E.size() > 0 || scene.states() > most_states || scene.constraints() > most_constraints)
    return text("it takes dense dynamics with at most %ld states and %ld constraints", long(most_states),
                long(most_constraints));
  return scene.free_rows.empty() ? "" : "it takes no free rows";
}

EventSolution integrate_with_events(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                                    const EventOptions& options) {
  return EventIntegration(scene, lcp_class, breakpoints, options).run();
}

const EventPiece& EventSolution::piece(double t, bool left) const {
  const auto after = [left](double at, const EventPiece& p) { return left ? at <= p.begin : at < p.begin; };
  auto it = std::upper_bound(pieces.begin(), pieces.end(), t, after);
  if (it != pieces.begin()) --it;
  return *it;
}

Vector EventSolution::x(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  return p.x.transpose() * legendre((std::clamp(t, p.begin, p.end) - p.begin) / p.length);
}

Vector EventSolution::y(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  return p.y.transpose() * legendre((std::clamp(t, p.begin, p.end) - p.begin) / p.length);
}

Vector EventSolution::integral_of_y(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  return p.integral +
         p.length * (p.y.transpose() * legendre_integrals((std::clamp(t, p.begin, p.end) - p.begin) / p.length));
}

}  // namespace bromwich
