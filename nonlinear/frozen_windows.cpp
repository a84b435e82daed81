#include "nonlinear/frozen_windows.hpp"

#include "core/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double inner_share = 0.1;  ///< of the change of a Newton iteration, which its inner iterations may leave
constexpr double rounding_of_rows = 1e-8;  ///< changes below that no longer fall are rounding
constexpr Index rows_of_a_range = 16;      ///< for a thread

// Linear between rows that stand h apart. Copies of a function share the rows.
struct Between {
  std::shared_ptr<const RowMatrix> rows;
  double h;

  void add(double t, Eigen::Ref<Vector> value) const {
    const Index j = std::clamp(Index(t / h), Index(0), rows->rows() - 2);
    const double s = t / h - double(j);
    value += (1 - s) * rows->row(j).transpose() + s * rows->row(j + 1).transpose();
  }
};

// Vectorised, as allFinite is not.
bool finite(const RowMatrix& m) { return (0 * m.array()).sum() == 0; }

TimeFunction sum(const TimeFunction& given, Between more) {
  return [given, more = std::move(more)](double t, Eigen::Ref<Vector> value) {
    value.setZero();
    if (given) given(t, value);
    more.add(t, value);
  };
}

// phi through B beside f: as B (f + phi), or as (F B) (f; phi).
void add_through_B(Scene& scene, Between phi) {
  if (!scene.f || scene.f_entry == SourceEntry::through_B) {
    scene.f_entry = SourceEntry::through_B;
    scene.F = SparseMatrix();
    scene.f = sum(scene.f, std::move(phi));
    return;
  }
  const Index own = scene.sources(), n = scene.constraints();
  SparseMatrix F = scene.F, both(scene.states(), own + n);
  if (scene.f_entry == SourceEntry::state) {
    F.resize(scene.states(), own);
    F.setIdentity();
  }
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&entries](const SparseMatrix& part, Index first) {
    for (Index k = 0; k < part.outerSize(); ++k)
      for (SparseMatrix::InnerIterator at(part, k); at; ++at)
        entries.emplace_back(int(at.row()), int(first + at.col()), at.value());
  };
  add(F, 0);
  add(scene.dynamics->inputs(), own);
  both.setFromTriplets(entries.begin(), entries.end());
  scene.F = std::move(both);
  scene.f_entry = SourceEntry::through_F;
  scene.f = [f = scene.f, own, phi = std::move(phi)](double t, Eigen::Ref<Vector> value) {
    value.setZero();
    f(t, value.head(own));
    phi.add(t, value.tail(value.size() - own));
  };
}

}  // namespace

Scene with_rest(const Scene& linear, bool of_trace, RowMatrix phi, RowMatrix gamma, double h) {
  Scene scene = linear;
  Between entering{std::make_shared<const RowMatrix>(std::move(phi)), h};
  if (entering.rows->size() > 0 && of_trace) {
    add_through_B(scene, std::move(entering));
  } else if (entering.rows->size() > 0) {
    take_f_as_values(scene);
    scene.f = sum(scene.f, std::move(entering));
  }
  scene.g = sum(scene.g, {std::make_shared<const RowMatrix>(std::move(gamma)), h});
  return scene;
}

FrozenWindows::FrozenWindows(const NonlinearScene& scene, Backend& backend, const NonlinearOptions& options,
                             NonlinearMethod method, Index J)
    : scene_(scene), backend_(backend), options_(options), method_(method), h_(scene.linear.T / double(J)) {}

std::optional<WindowsOfSteps::Outcome> FrozenWindows::solve(Index from, Index length, const Vector& state, Rows& rows) {
  from_ = from;
  window_ = part_of(scene_.linear, time(0), double(length) * h_, state);
  window_.default_steps = length;
  window_.breakpoints_are_all = true;
  window_.exact = {};
  if (!solver_ || length_ != length) {
    Options inner;
    inner.steps = length;
    inner.states = scene_.of_trace ? StateSelection::none : StateSelection::all;
    inner.trace = scene_.of_trace;
    inner.interrupted = options_.interrupted;
    inner.method = options_.inner;
    inner.confirm = false;  // one of many; the solution of the nonlinear scene is looked at
    const RowMatrix phi = RowMatrix::Zero(scene_.phi ? length + 1 : 0, scene_.seen()),
                    gamma = RowMatrix::Zero(length + 1, scene_.linear.constraints());
    solver_ = std::make_unique<Solver>(with_rest(window_, scene_.of_trace, phi, gamma, h_), backend_, inner);
    length_ = length;
  } else {
    solver_->set_x0(state);
  }
  return method_ == NonlinearMethod::newton ? newton(rows) : iterate(nullptr, options_.tolerance, rows);
}

Vector FrozenWindows::end_state(const Rows& rows) {
  if (!scene_.of_trace) return rows.seen.row(length_).transpose();
  last_.y = rows.y;
  return states_at(solver_->scene(), backend_, last_, {length_}).col(0);
}

std::array<Linearization, 2> FrozenWindows::linearize_at(Index row, const Rows& about) const {
  const Vector x = about.seen.row(row), y = about.y.row(row);
  return {linearize(scene_.phi, scene_.dphi, scene_.seen(), time(row), x, y),
          linearize(scene_.gamma, scene_.dgamma, y.size(), time(row), x, y)};
}

void FrozenWindows::rest_at(Index j, const Linearizations* at, const Rows& rows, RowMatrix& phi,
                            RowMatrix& gamma) const {
  const Vector x = rows.seen.row(j), y = rows.y.row(j);
  if (at) {
    const auto& [p, g] = at->kept.empty() ? linearize_at(j, at->about) : at->kept[std::size_t(j)];
    const Vector dx = x - at->about.seen.row(j).transpose(), dy = y - at->about.y.row(j).transpose();
    if (scene_.phi) phi.row(j) = (p.value + p.by_x * dx + p.by_y * dy).transpose();
    gamma.row(j) = (g.value + g.by_x * dx + g.by_y * dy).transpose();
    return;
  }
  const auto set = [&](const NonlinearFunction& function, RowMatrix& values) {
    if (!function) return;
    Vector value = Vector::Zero(values.cols());
    function(time(j), x, y, value);
    values.row(j) = value.transpose();
  };
  set(scene_.phi, phi);
  set(scene_.gamma, gamma);
}

// Values of phi (no rows where it is empty) and gamma at all rows, linearized where that is given.
void FrozenWindows::rest(const Linearizations* at, const Rows& rows, RowMatrix& phi, RowMatrix& gamma) const {
  const Index count = rows.seen.rows();
  phi = RowMatrix::Zero(scene_.phi ? count : 0, scene_.seen());
  gamma = RowMatrix::Zero(count, scene_.linear.constraints());
  each_row(count, [&](Index j) { rest_at(j, at, rows, phi, gamma); });
}

// On all threads of the host where phi and gamma may be called concurrently.
void FrozenWindows::each_row(Index count, const std::function<void(Index)>& use) const {
  const HostThreads one;
  share(options_.concurrent ? static_cast<const HostThreads&>(backend_) : one, count, rows_of_a_range,
        [&](Index first, Index last) {
          for (Index j = first; j < last; ++j) use(j);
        });
}

// One linear solve. False if it fails.
bool FrozenWindows::sweep(RowMatrix phi, RowMatrix gamma, Rows& rows) {
  const Scene now = with_rest(window_, scene_.of_trace, std::move(phi), std::move(gamma), h_);
  solver_->set_sources(now.f, now.g, now.breakpoints, true);
  ++solves_;
  last_ = solver_->solve();
  interrupted_ = last_.status == Status::interrupted;
  reason_ = last_.reason;
  RowMatrix& seen = scene_.of_trace ? last_.trace : last_.x;
  if (last_.status != Status::solved || !finite(seen) || !finite(last_.y)) return false;
  if (by_euler(last_)) {
    reason_ = "the linear solve takes steps of implicit Euler";
    return false;
  }
  continuous_ = last_.continuous;
  rows = {std::move(seen), std::move(last_.y)};
  return true;
}

// Iterates rows until the change is below `tolerance`.
std::optional<WindowsOfSteps::Outcome> FrozenWindows::iterate(const Linearizations* at, double tolerance, Rows& rows) {
  ContractionWatch watch(tolerance);
  bool vanished = false;
  for (Index k = 1; k <= options_.most_iterations; ++k) {
    RowMatrix phi, gamma;
    rest(at, rows, phi, gamma);
    const bool vanish = phi.isZero(0) && gamma.isZero(0);
    if (vanished && vanish) return Outcome{};  // the solution of the linear scene is that of the nonlinear one
    vanished = vanish;
    if (!finite(phi) || !finite(gamma)) {
      reason_ = "phi or gamma is not finite";
      return std::nullopt;
    }
    Rows next;
    if (!sweep(std::move(phi), std::move(gamma), next)) return std::nullopt;
    const double change = apart(next, rows);
    rows = std::move(next);
    const ContractionWatch::Verdict verdict = watch.after(change);
    if (verdict == ContractionWatch::Verdict::converged) return Outcome{watch.contraction(), change};
    if (verdict == ContractionWatch::Verdict::go_on) continue;
    reason_ = text("the iteration contracts by %.2g only", watch.last());
    return std::nullopt;
  }
  reason_ = text("the iteration does not end within %ld linear solves", long(options_.most_iterations));
  return std::nullopt;
}

std::optional<WindowsOfSteps::Outcome> FrozenWindows::newton(Rows& rows) {
  const double row_bytes =
      sizeof(double) * double(rows.seen.cols() + rows.y.cols()) * double(rows.seen.cols() + rows.y.cols());
  double tolerance = inner_share;
  Outcome outcome;
  for (Index k = 0; k < options_.most_newton; ++k) {
    ++newton_;
    Linearizations at{rows, {}};
    if (double(rows.seen.rows()) * row_bytes <= most_kept) {
      at.kept.resize(std::size_t(rows.seen.rows()));
      each_row(rows.seen.rows(), [&](Index j) { at.kept[std::size_t(j)] = linearize_at(j, rows); });
    }
    const std::optional<Outcome> inner = iterate(&at, tolerance, rows);
    if (!inner) return std::nullopt;
    outcome = {std::max(outcome.contraction, inner->contraction), apart(rows, at.about)};
    const double change = outcome.change;
    if (change <= options_.tolerance || (tolerance <= options_.tolerance && change <= rounding_of_rows)) return outcome;
    tolerance = std::clamp(inner_share * change * std::min(1.0, change), options_.tolerance, inner_share);
  }
  reason_ = text("Newton's iteration does not end within %ld iterations", long(options_.most_newton));
  return std::nullopt;
}

}  // namespace bromwich
