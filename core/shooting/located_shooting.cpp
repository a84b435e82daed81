#include "core/shooting/located_shooting.hpp"

#include "core/base/text.hpp"
#include "core/events/collocation.hpp"
#include "core/events/event_sources.hpp"
#include "core/kernel/start_rounding.hpp"
#include "core/scene/memory.hpp"
#include "core/shooting/divided_shooting.hpp"
#include "core/shooting/flow_derivative.hpp"
#include "core/shooting/shooting_matrix.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

namespace bromwich {

namespace {

constexpr double small_step = 1e-10;     ///< of the sizes of x: the next step would be rounding
constexpr double stagnant_step = 1e-7;   ///< likewise: a step after which F no longer falls
constexpr double rounding_of_F = 1e-14;  ///< of its terms
constexpr double small_F = 1e-6;         ///< likewise: after more, no step is the last
constexpr double finest_flow = 1e-12;
constexpr double least_size = 1e-3;  ///< of the largest component: sizes of others are at least that
constexpr int most_newton = 40, most_halved = 8;
constexpr int first_halved = 3, most_ahead = 10;  ///< shorter steps before whole ones go on, and these
constexpr int slow_steps = 6;                     ///< of Newton's method, within which F halves
constexpr double slow_fall = 0.1;   ///< of F in a step of Newton's method: after less, longer steps are tried
constexpr double longest_step = 8;  ///< of those, in steps
constexpr int first_periods = 2, later_periods = 20, most_periods = 140;
constexpr double settles = 0.99;          ///< of F before some periods, at most
constexpr double drifting = 1e-2;         ///< of what a period moves: difference to the one before
constexpr double most_at_once = 1 << 16;  ///< periods

class LocatedShooting {
 public:
  LocatedShooting(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                  const ShootingOptions& options)
      : scene_(scene),
        c_(*scene.boundary),
        class_(lcp_class),
        breakpoints_(breakpoints),
        options_(options),
        derivative_(scene),
        size_(Vector::Zero(scene.states())),
        least_(least_size * motion_of(scene)) {
    scene_.boundary.reset();
  }

  ShootingSolution run() {
    if (!begin() || !find()) return ended();
    solution_.found = true;
    return std::move(solution_);
  }

 private:
  struct Iterate {
    Vector x;
    EventSolution flow;
    Vector F = {};
    double defect = INFINITY;
  };

  // Steps of Newton's method through other pieces lead nearer, or far away. Periods go on from where they were, and
  // from where the method has come.
  bool find() {
    Iterate settled = now_;
    if (newton()) return true;
    for (int periods = later_periods; periodic_ && periods <= most_periods; periods += later_periods) {
      Iterate reached = now_;
      ahead_ = INFINITY;
      if (newton_behind_periods(settled) || newton_behind_periods(reached)) return true;
    }
    return false;
  }

  ShootingSolution ended() {
    if (solution_.reason.empty()) solution_.reason = why_;
    return std::move(solution_);
  }

  bool give_up(const std::string& why) {
    why_ = why;
    return false;
  }

  std::optional<Iterate> integrate(const Vector& x) {
    if (work_ > options_.most_work) return give_up("too many steps"), std::nullopt;
    scene_.x0 = x;
    Iterate it{x, {}};
    EventOptions o = options_.events;
    o.kept = kept_;
    it.flow = integrate_closely(scene_, class_, breakpoints_, o);
    ++solution_.flows;
    work_ += it.flow.work;
    if (!it.flow.complete) {
      solution_.interrupted = it.flow.interrupted;
      return give_up(it.flow.reason), std::nullopt;
    }
    it.F = c_.E0 * x + c_.ET * end_of_flow(it.flow) - c_.b;
    return it;
  }

  // The same from the nearest x that fulfils the constraints which no y moves, if x does not.
  std::optional<Iterate> flow_from(const Vector& x) {
    if (auto it = integrate(x)) return it;
    if (solution_.interrupted) return std::nullopt;
    const Vector projected = nearest_feasible(scene_, x, size_of_states());
    return projected == x ? std::nullopt : integrate(projected);
  }

  // How far f may move the states within T, and y in motion_by_y(). Where one holds them against the other, x is
  // rounding of this.
  static Vector motion_of(const Scene& scene) {
    const EventSources sources(scene);
    const Vector rest = Vector::Zero(scene.states());
    Vector f = rest;
    for (int k = 0; k <= 8; ++k) f = f.cwiseMax(sources.f(scene.T * k / 8).cwiseAbs());
    const Matrix& A = scene.dynamics->small_state()->A;
    return terms_of_motion(A, Matrix::Identity(rest.size(), rest.size()), rest, f, rest, scene.T);
  }

  static Matrix motion_by_y(const Scene& scene) {
    const DenseDynamics& d = *scene.dynamics->small_state();
    return motion_within(scene.T, d.A) * d.B.cwiseAbs();
  }

  Vector size_of_states() const {
    const Vector size = size_.cwiseMax(least_);
    const double most = size.size() > 0 ? size.maxCoeff() : 0;
    if (!(most > 0)) return Vector::Ones(size.size());
    return size.cwiseMax(least_size * most);
  }

  bool bounded(const Matrix& D) const { return (D * size_of_states().asDiagonal()).allFinite(); }

  double defect_of(const Vector& F) const {
    const Vector of = (c_.E0.cwiseAbs() + c_.ET.cwiseAbs()) * size_of_states() + c_.b.cwiseAbs();
    double most = 0;
    for (Index i = 0; i < F.size(); ++i)
      if (F[i] != 0) most = std::max(most, std::abs(F[i]) / of[i]);
    return F.allFinite() ? most : INFINITY;
  }

  void take(Iterate it) {
    now_ = std::move(it);
    set_sizes();
    now_.defect = defect_of(now_.F);
    solution_.history.push_back(now_.defect);
  }

  void resume(Iterate it) {
    now_ = std::move(it);
    set_sizes();
  }

  void set_sizes() {
    Vector y = Vector::Zero(scene_.constraints());
    for (const EventPiece& p : now_.flow.pieces) y = y.cwiseMax(p.y.cwiseAbs().colwise().sum().transpose());
    size_ = largest_values(now_.flow, &EventPiece::x).cwiseMax(least_size * by_y_ * y);
  }

  void start_in_modes(Vector& x) const {
    const std::vector<Index> modes = modes_at_start(scene_);
    for (std::size_t k = 0; k < modes.size(); ++k) x[scene_.memories[k].state] = double(modes[k]);
  }

  bool begin() {
    Vector x = options_.start;
    const bool given = x.size() > 0;
    if (!given) x = c_.E0.completeOrthogonalDecomposition().solve(c_.b);
    if (!given) start_in_modes(x);
    auto it = flow_from(x);
    if (!it) return false;
    take(std::move(*it));
    return given || !periodic_ || settle(first_periods);
  }

  // Periods from the last iterate on. Where one moves what E0 + ET D leaves open as the one before did, the state
  // drifts towards a constraint, and twice as many periods are passed at once. Newton's method takes all else to its
  // end.
  bool settle(int periods) {
    double at_once = 1;
    for (int k = 0; k < periods && now_.defect > rounding_of_F; ++k) {
      const Matrix D = derivative_.at_end(now_.flow);
      if (!bounded(D)) return give_up("changes of x(0) grow without bounds");
      const ShootingMatrix K(c_, D, size_of_states());
      const Vector drift = K.drift(c_, -now_.F);
      auto it = flow_from(at_once > 1 ? Vector(now_.x + K.solve(-now_.F - c_.E0 * drift) + at_once * drift)
                                      : end_of_flow(now_.flow));
      if (!it && (solution_.interrupted || at_once == 1)) return false;
      const bool alike = it && !K.regular && (K.drift(c_, -it->F) - drift).norm() <= drifting * drift.norm();
      if (alike && at_once > most_at_once)
        return give_up(text("the state drifts: after %.0f periods each still moves it as the first did", at_once));
      if (alike || at_once == 1) take(std::move(*it));
      at_once = alike ? 2 * at_once : std::max(at_once / 4, 1.0);
    }
    return true;
  }

  // From periods behind `from`, which becomes their end. Where they do not bring F down, from parts of the last.
  bool newton_behind_periods(Iterate& from) {
    if (solution_.interrupted) return false;
    const std::string why = why_;
    const double before = from.defect;
    resume(from);
    if (!settle(later_periods)) return false;
    from = now_;
    if (now_.defect <= settles * before) return newton();
    if (newton_from_parts()) return true;
    if (solution_.interrupted) return false;
    resume(from);
    return give_up(why);
  }

  // Where the state does not settle, it goes around an unstable solution.
  bool newton_from_parts() {
    const Vector x = shoot_in_parts(scene_, c_, class_, breakpoints_, options_.events, now_.flow, size_of_states());
    if (x.size() == 0) return false;
    auto it = flow_from(x);
    if (!it) return false;
    take(std::move(*it));
    return newton();
  }

  // False where steps do not bring F down.
  bool newton() {
    std::vector<double> before;
    for (int k = 0; k < most_newton; ++k) {
      solution_.D = derivative_.at_end(now_.flow);
      if (!bounded(solution_.D)) return give_up("changes of x(0) grow without bounds");
      const ShootingMatrix K(c_, solution_.D, size_of_states());
      solution_.determined = K.regular;
      const Vector& values = K.svd.singularValues();
      solution_.condition = values[0] > 0 ? values[values.size() - 1] / values[0] : 0;
      solution_.free = std::all_of(now_.flow.pieces.begin(), now_.flow.pieces.end(),
                                   [](const EventPiece& p) { return !p.passed && p.active.empty(); });
      const Vector dx = K.solve(-now_.F);
      const double step = (dx.cwiseAbs().array() / size_of_states().array()).maxCoeff();
      // Where x(0) is one of several, no step of theirs need end the rounding of the flow.
      const double zero = K.regular ? rounding_of_F : options_.events.tolerance;
      if (!K.regular && now_.defect > zero && !solvable(K))
        return give_up("E0 + ET D is singular (D: the derivative of x(T) by x(0)), and no x(0) was found");
      if ((step <= small_step && now_.defect <= small_F) || now_.defect <= zero) {
        solution_.x0 = without_rounding(now_.x + dx);
        return true;
      }
      if (periodic_ && k >= slow_steps && now_.defect > before[k - slow_steps] / 2) break;
      before.push_back(now_.defect);
      ++solution_.newton;
      if (!descend(dx)) {
        if (solution_.interrupted || step > stagnant_step || now_.defect > small_F) return false;
        solution_.x0 = now_.x;
        return true;
      }
    }
    return give_up(text("Newton's method ends with %.1e of the boundary condition", now_.defect));
  }

  // What x is off a constraint by rounding is taken away. More is an impulse at t = 0, where y moves the constraint.
  Vector without_rounding(const Vector& x) const {
    const Vector size = size_of_states(), on = nearest_feasible(scene_, x, size);
    const bool near = ((on - x).cwiseAbs().array() <= small_step * size.array()).all();
    return near ? on : nearest_feasible(scene_, x, size, RowsOfStart::without_impulses);
  }

  // Whether the part of F that no dx moves is error of the flow.
  bool solvable(const ShootingMatrix& K) const {
    const Vector F = K.rows.asDiagonal() * now_.F;
    const Matrix U = K.svd.matrixU().leftCols(K.svd.rank());
    return (F - U * (U.transpose() * F)).norm() <= 1e-6 * F.norm() + options_.events.tolerance;
  }

  // F is smooth in pieces. Where short steps would stay within one, whole steps go on from piece to piece, though F may
  // rise on the way.
  bool run_ahead(Vector dx) {
    const Iterate best = now_;
    for (int k = 0; k < most_ahead; ++k) {
      auto it = flow_from(now_.x + dx);
      if (!it) break;
      take(std::move(*it));
      if (now_.defect <= best.defect / 2) return true;
      const Matrix D = derivative_.at_end(now_.flow);
      if (!bounded(D)) break;
      dx = ShootingMatrix(c_, D, size_of_states()).solve(-now_.F);
    }
    resume(best);
    ahead_ = best.defect / 2;
    return false;
  }

  bool descend(const Vector& dx) {
    double share = 1;
    for (int k = 0; k <= most_halved; ++k, share /= 2) {
      if (k == first_halved && now_.defect <= ahead_ && run_ahead(dx)) return true;
      if (solution_.interrupted) return false;
      auto it = flow_from(now_.x + share * dx);
      if (solution_.interrupted) return false;
      if (!it || !(defect_of(it->F) <= (1 - 0.1 * share) * now_.defect)) continue;
      const double before = now_.defect;
      const Vector x = now_.x;
      take(std::move(*it));
      return share < 1 || now_.defect <= slow_fall * before || go_further(x, dx);
    }
    return give_up(text("Newton's method ends with %.1e of the boundary condition", now_.defect));
  }

  // At the border of states that stay, such as those that friction holds, F vanishes with a power of the distance.
  // Newton's method takes a share of it each time; longer steps pass the border.
  bool go_further(const Vector& x, const Vector& dx) {
    for (double share = 2; share <= longest_step; share *= 2) {
      auto it = flow_from(x + share * dx);
      if (solution_.interrupted) return false;
      if (!it || !(defect_of(it->F) < now_.defect)) break;
      take(std::move(*it));
    }
    return true;
  }

  Scene scene_;  ///< with initial values
  const BoundaryCondition c_;
  const bool periodic_ = is_periodic(c_);
  const LcpClass class_;
  const std::vector<double>& breakpoints_;
  const ShootingOptions& options_;
  FlowDerivative derivative_;
  const std::shared_ptr<RegimesOfScene> kept_ = keep_regimes();
  Vector size_;                              ///< m: largest values of the last flow, and of what y may move
  const Vector least_;                       ///< m: sizes are at least these
  const Matrix by_y_ = motion_by_y(scene_);  ///< m x n
  Iterate now_;
  double ahead_ = periodic_ ? 0 : INFINITY;  ///< F from which whole steps may go on: not before some periods are passed
  double work_ = 0;
  std::string why_;
  ShootingSolution solution_;
};

}  // namespace

EventSolution integrate_closely(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                                EventOptions options) {
  double work = 0;
  for (;; options.tolerance /= 10) {
    EventSolution s = integrate_with_events(scene, lcp_class, breakpoints, options);
    s.work = work += s.work;
    const bool again = !s.complete && !s.interrupted && s.end != EventEnd::out_of_work;
    if (!again || options.tolerance < 10 * finest_flow) return s;
  }
}

Vector end_of_flow(const EventSolution& s) {
  const EventPiece& last = s.pieces.back();
  return last.x.transpose() * legendre((last.end - last.begin) / last.length);
}

std::vector<Complex> multipliers_of(const Matrix& D) {
  const ComplexVector values = Eigen::EigenSolver<Matrix>(D, false).eigenvalues();
  std::vector<Complex> sorted(values.begin(), values.end());
  std::stable_sort(sorted.begin(), sorted.end(), [](Complex a, Complex b) { return std::abs(a) > std::abs(b); });
  return sorted;
}

bool is_periodic(const BoundaryCondition& c) {
  return c.E0 == -c.ET && (c.b.array() == 0).all() && Eigen::FullPivLU<Matrix>(c.E0).isInvertible();
}

ShootingSolution shoot_on_events(const Scene& scene, LcpClass lcp_class, const std::vector<double>& breakpoints,
                                 const ShootingOptions& options) {
  return LocatedShooting(scene, lcp_class, breakpoints, options).run();
}

StartError error_of_start(const Scene& scene, const ShootingSolution& found, const EventSolution& flow) {
  const BoundaryCondition& c = *scene.boundary;
  Vector size = found.x0.cwiseAbs();
  for (const EventPiece& p : flow.pieces) size = size.cwiseMax((p.x.transpose() * legendre(0)).cwiseAbs());
  size = size.cwiseMax(std::max(least_size * size.maxCoeff(), 1e-290));
  const Vector dx = ShootingMatrix(c, found.D, size).solve(c.b - c.E0 * found.x0 - c.ET * end_of_flow(flow));
  const FlowChange most = FlowDerivative(scene).along(flow, dx);
  return {most.x, most.y};
}

}  // namespace bromwich
