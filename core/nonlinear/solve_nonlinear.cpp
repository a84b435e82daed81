#include "core/nonlinear/solve_nonlinear.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/nonlinear/nonlinear_steps.hpp"
#include "core/solve/solver.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

namespace bromwich {

namespace {

constexpr double too_slow = 0.7;     ///< contraction above: shorter windows
constexpr Index looked_at = 4;       ///< iterations before the contraction counts
constexpr double inner_share = 0.1;  ///< of the change of a Newton iteration, which its inner iterations may leave

double relative(const RowMatrix& change, const RowMatrix& size) {
  if (change.size() == 0) return 0;
  const double most = change.cwiseAbs().maxCoeff();
  return most > 0 ? most / (size.cwiseAbs().maxCoeff() + most) : 0;
}

// Linear between rows that stand h apart.
TimeFunction with_rows(const TimeFunction& given, RowMatrix rows, double h) {
  return [given, rows = std::move(rows), h](double t, Eigen::Ref<Vector> value) {
    const Index last = rows.rows() - 1;
    const Index j = std::clamp(Index(t / h), Index(0), last - 1);
    const double s = t / h - double(j);
    if (given)
      given(t, value);
    else
      value.setZero();
    value += (1 - s) * rows.row(j).transpose() + s * rows.row(j + 1).transpose();
  };
}

struct Rows {
  RowMatrix x, y;
};

class NonlinearSolve {
 public:
  NonlinearSolve(const NonlinearScene& scene, Backend& backend, const NonlinearOptions& options)
      : scene_(scene),
        backend_(backend),
        options_(options),
        m_(scene.linear.states()),
        n_(scene.linear.constraints()),
        J_(options.steps > 0 ? options.steps : scene.linear.default_steps) {}

  NonlinearResult run() {
    result_.method = options_.method == NonlinearMethod::automatic ? NonlinearMethod::march : options_.method;
    result_.t = Vector::LinSpaced(J_ + 1, 0, scene_.linear.T);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    result_.x = RowMatrix::Constant(J_ + 1, m_, nan);
    result_.y = result_.w = RowMatrix::Constant(J_ + 1, n_, nan);
    result_.x.row(0) = scene_.linear.x0.transpose();
    NonlinearSteps steps = make_steps(StepRule::linear);
    Vector y = Vector::Zero(n_);
    if (steps.lcp_class(scene_.linear.x0, y) == LcpClass::Z) steps.select_least();
    const bool starts = steps.y_at(0, scene_.linear.x0, y).solved;
    const LcpClass of_y = steps.lcp_class(scene_.linear.x0, y);
    result_.continuous = starts && (of_y == LcpClass::P || of_y == LcpClass::Z);
    if (!result_.continuous) {
      y.setZero();
      if (result_.method != NonlinearMethod::march) {
        result_.reason = "M + dgamma/dy is not of class P or Z, so that y may jump: use method march";
        return std::move(result_);
      }
      steps = make_steps(StepRule::radau);
    }
    steps_ = &steps;
    result_.y.row(0) = y.transpose();
    result_.w.row(0) = steps.slack(0, scene_.linear.x0, y).transpose();
    const bool solved = result_.method == NonlinearMethod::march ? march(0, J_) : by_windows();
    if (solved) result_.status = Status::solved;
    certify();
    return std::move(result_);
  }

 private:
  NonlinearSteps make_steps(StepRule rule) const {
    return NonlinearSteps(scene_, backend_, J_, rule, options_.tolerance, options_.most_newton);
  }

  bool fail(Status status, const std::string& why) {
    result_.status = status;
    result_.reason = why;
    return false;
  }

  void take_row(Index j, const Vector& x, const Vector& y) {
    result_.x.row(j) = x.transpose();
    result_.y.row(j) = y.transpose();
    result_.w.row(j) = steps_->slack(j, x, y).transpose();
  }

  bool march(Index from, Index to) {
    Vector x = result_.x.row(from), y = result_.y.row(from);
    for (Index j = from + 1; j <= to; ++j) {
      if (options_.interrupted && options_.interrupted()) return fail(Status::interrupted, "stopped on request");
      const NewtonOutcome outcome = steps_->take(j, x, y);
      result_.newton += outcome.iterations;
      if (!outcome.solved)
        return fail(Status::tolerance_not_met,
                    text("Newton's iteration of the step to t = %.6g does not converge (last change %.1e after %ld "
                         "iterations); try more steps",
                         steps_->time(j), outcome.change, long(outcome.iterations)));
      ++result_.marched;
      take_row(j, x, y);
    }
    return true;
  }

  bool by_windows() {
    Index from = 0, length = J_;
    while (from < J_) {
      length = std::min(length, J_ - from);
      if (length == 1) {
        if (!march(from, from + 1)) return false;
        ++from;
        length = 2;
        continue;
      }
      const std::optional<double> contraction = solve_window(from, length);
      if (result_.status == Status::interrupted) return false;
      if (!contraction) {
        length = (length + 1) / 2;
        continue;
      }
      ++result_.windows;
      result_.contraction = std::max(result_.contraction, *contraction);
      from += length;
    }
    return true;
  }

  // The linear problem of a window, with the rest as sources.
  Scene frozen(Index from, Index length) const {
    Scene window = part_of(scene_.linear, steps_->time(from), steps_->time(length), result_.x.row(from).transpose());
    window.default_steps = length;
    window.breakpoints_are_all = true;
    window.exact = {};
    return window;
  }

  // Values of phi and gamma at all rows, linearized about `about` where `at` are given.
  void rest(const Rows& about, const std::vector<std::array<Linearization, 2>>* at, const Rows& rows, Index from,
            RowMatrix& phi, RowMatrix& gamma) const {
    const Index count = rows.x.rows();
    phi = RowMatrix::Zero(count, m_);
    gamma = RowMatrix::Zero(count, n_);
    for (Index j = 0; j < count; ++j) {
      const Vector x = rows.x.row(j), y = rows.y.row(j);
      if (at) {
        const auto& [p, g] = (*at)[std::size_t(j)];
        const Vector dx = x - about.x.row(j).transpose(), dy = y - about.y.row(j).transpose();
        phi.row(j) = (p.value + p.by_x * dx + p.by_y * dy).transpose();
        gamma.row(j) = (g.value + g.by_x * dx + g.by_y * dy).transpose();
        continue;
      }
      Vector value = Vector::Zero(m_), slack = Vector::Zero(n_);
      if (scene_.phi) scene_.phi(steps_->time(from + j), x, y, value);
      if (scene_.gamma) scene_.gamma(steps_->time(from + j), x, y, slack);
      phi.row(j) = value.transpose();
      gamma.row(j) = slack.transpose();
    }
  }

  // One linear solve. Nothing if it fails.
  bool sweep(Solver& solver, const Scene& window, RowMatrix phi, RowMatrix gamma, Rows& rows) {
    solver.set_sources(with_rows(window.f, std::move(phi), h()), with_rows(window.g, std::move(gamma), h()), {}, true);
    ++result_.solves;
    const Result r = solver.solve();
    if (r.status == Status::interrupted) fail(Status::interrupted, "stopped on request");
    if (r.status != Status::solved || !r.x.allFinite()) return false;
    rows.x = r.x;
    rows.y = r.y;
    return true;
  }

  double h() const { return scene_.linear.T / double(J_); }

  // Iterates rows until the change is below `tolerance`. The contraction, or nothing.
  std::optional<double> iterate(Solver& solver, const Scene& window, const Rows& about,
                                const std::vector<std::array<Linearization, 2>>* at, double tolerance, Index from,
                                Rows& rows) {
    double before = INFINITY, contraction = 0;
    for (Index k = 1; k <= options_.most_iterations; ++k) {
      RowMatrix phi, gamma;
      rest(about, at, rows, from, phi, gamma);
      if (!phi.allFinite() || !gamma.allFinite()) return std::nullopt;
      Rows next;
      if (!sweep(solver, window, std::move(phi), std::move(gamma), next)) return std::nullopt;
      const double change = std::max(relative(next.x - rows.x, next.x), relative(next.y - rows.y, next.y));
      rows = std::move(next);
      if (k > 1 && before > 0) {
        const double now = change / before;
        if (change > 100 * tolerance) contraction = std::max(k > 2 ? contraction : 0, now);
        if (k > looked_at && now > too_slow && change > stalled) return std::nullopt;
      }
      // What the iterations to come change.
      const double left = change * contraction / (1 - std::min(contraction, 0.9));
      if (change <= tolerance || (k > 2 && left <= 0.1 * tolerance) || (change <= stalled && change > before / 2))
        return contraction;
      before = change;
    }
    return std::nullopt;
  }
  static constexpr double stalled = 1e-8;  ///< changes below that no longer halve are rounding

  std::optional<double> solve_window(Index from, Index length) {
    const Scene window = frozen(from, length);
    Options inner;
    inner.steps = length;
    inner.states = StateSelection::all;
    inner.interrupted = options_.interrupted;
    inner.method = options_.inner;
    Solver solver(window, backend_, inner);
    Rows rows{result_.x.row(from).replicate(length + 1, 1), result_.y.row(from).replicate(length + 1, 1)};
    const std::optional<double> contraction =
        result_.method == NonlinearMethod::newton
            ? newton(solver, window, from, rows)
            : iterate(solver, window, rows, nullptr, options_.tolerance, from, rows);
    if (!contraction) return std::nullopt;
    for (Index j = 1; j <= length; ++j) take_row(from + j, rows.x.row(j).transpose(), rows.y.row(j).transpose());
    return contraction;
  }

  std::optional<double> newton(Solver& solver, const Scene& window, Index from, Rows& rows) {
    double tolerance = inner_share, contraction = 0;
    for (Index k = 0; k < options_.most_newton; ++k) {
      ++result_.newton;
      const Rows about = rows;
      std::vector<std::array<Linearization, 2>> at;
      for (Index j = 0; j < rows.x.rows(); ++j) {
        const double t = steps_->time(from + j);
        const Vector x = rows.x.row(j), y = rows.y.row(j);
        at.push_back(
            {linearize(scene_.phi, scene_.dphi, m_, t, x, y), linearize(scene_.gamma, scene_.dgamma, n_, t, x, y)});
      }
      const std::optional<double> inner = iterate(solver, window, about, &at, tolerance, from, rows);
      if (!inner) return std::nullopt;
      contraction = std::max(contraction, *inner);
      const double change = std::max(relative(rows.x - about.x, rows.x), relative(rows.y - about.y, rows.y));
      if (change <= options_.tolerance || (tolerance <= options_.tolerance && change <= stalled)) return contraction;
      tolerance = std::clamp(inner_share * change * std::min(1.0, change), options_.tolerance, inner_share);
    }
    return std::nullopt;
  }

  void certify() {
    const Matrix M = to_dense(scene_.linear.M);
    for (Index j = result_.continuous ? 0 : 1; j <= J_ && result_.x.row(j).allFinite(); ++j) {
      const Vector y = result_.y.row(j), w = result_.w.row(j);
      if (n_ > 0) {
        const Vector fixed = w - M * y;
        result_.residual = std::max(result_.residual,
                                    w.cwiseMin(y).cwiseAbs().maxCoeff() / std::max(1.0, fixed.cwiseAbs().maxCoeff()));
      }
      if (j == 0 || !result_.continuous) continue;
      const Vector x0 = result_.x.row(j - 1), y0 = result_.y.row(j - 1), x1 = result_.x.row(j);
      result_.defect = std::max(result_.defect, steps_->defect(j, x0, y0, x1, y).cwiseAbs().maxCoeff() /
                                                    std::max(1.0, x1.cwiseAbs().maxCoeff()));
    }
  }

  const NonlinearScene& scene_;
  Backend& backend_;
  const NonlinearOptions& options_;
  const Index m_, n_, J_;
  NonlinearSteps* steps_ = nullptr;
  NonlinearResult result_;
};

// With f as m values, however it was stated.
NonlinearScene with_state_source(NonlinearScene scene) {
  Scene& linear = scene.linear;
  if (!linear.f || linear.f_entry == SourceEntry::state) return scene;
  const Matrix F = source_matrix(linear, *linear.dynamics->small_state());
  linear.f = [f = linear.f, F](double t, Eigen::Ref<Vector> v) {
    Vector phi(F.cols());
    f(t, phi);
    v = F * phi;
  };
  linear.f_entry = SourceEntry::state;
  linear.F = SparseMatrix();
  return scene;
}

// The largest difference at the points of the coarser grid, each component relative to its largest value, or to 1e-3 of
// the largest of its kind.
double apart(const RowMatrix& coarse, const RowMatrix& fine) {
  double largest = 0;
  if (fine.size() == 0) return 0;
  const double all = fine.cwiseAbs().maxCoeff();
  for (Index i = 0; i < coarse.cols(); ++i) {
    double difference = 0, size = 1e-3 * all;
    for (Index j = 0; j < coarse.rows(); ++j) {
      difference = std::max(difference, std::abs(coarse(j, i) - fine(2 * j, i)));
      size = std::max(size, std::abs(fine(2 * j, i)));
    }
    if (difference > 0) largest = std::max(largest, difference / size);
  }
  return largest;
}

// Grids of J, 2J, 4J, ... steps until two differences, of which the second is smaller, say that the error is reached.
NonlinearResult refine(const NonlinearScene& scene, Backend& backend, NonlinearOptions options) {
  if (options.steps == 0) options.steps = scene.linear.default_steps;
  NonlinearResult coarse;
  double before = 0;
  for (;; options.steps *= 2) {
    NonlinearResult fine = NonlinearSolve(scene, backend, options).run();
    if (fine.status == Status::interrupted || fine.status == Status::unsupported) return fine;
    const bool both = fine.status == Status::solved && coarse.status == Status::solved;
    const double now = both ? std::max(apart(coarse.x, fine.x), fine.continuous ? apart(coarse.y, fine.y) : 0) : 0;
    if (both && before > 0) {
      const double order = std::clamp(std::log2(before / std::max(now, 1e-300)), 0.0, 2.0);
      if (order >= 0.5) fine.error_estimate = now / (std::exp2(order) - 1);
      if (fine.error_estimate && *fine.error_estimate <= options.error) return fine;
    }
    if (2 * options.steps > options.max_steps) {
      if (fine.status == Status::solved)
        fine.reason = fine.error_estimate
                          ? text("the error is about %.1e with %ld steps, not %.1e: more than %ld would be needed",
                                 *fine.error_estimate, long(options.steps), options.error, long(options.max_steps))
                          : "the error could not be estimated: the differences of grids do not fall";
      fine.status = Status::tolerance_not_met;
      return fine;
    }
    before = now;
    coarse = std::move(fine);
  }
}

}  // namespace

const char* to_string(NonlinearMethod method) {
  switch (method) {
    case NonlinearMethod::automatic:
      return "automatic";
    case NonlinearMethod::march:
      return "march";
    case NonlinearMethod::iteration:
      return "iteration";
    case NonlinearMethod::newton:
      return "newton";
  }
  return "?";
}

NonlinearResult solve_nonlinear(const NonlinearScene& scene, Backend& backend, const NonlinearOptions& options) {
  scene.validate();
  if (!(options.tolerance > 0)) throw Error("tolerance", text("found %g", options.tolerance), "give a positive number");
  if (options.steps < 0) throw Error("steps", text("found %ld", long(options.steps)), "give a positive number");
  if (!(options.error >= 0)) throw Error("error", text("found %g", options.error), "give a positive number, or 0");
  const NonlinearScene stated = with_state_source(scene);
  return options.error > 0 ? refine(stated, backend, options) : NonlinearSolve(stated, backend, options).run();
}

}  // namespace bromwich
