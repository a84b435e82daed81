// Reaction and diffusion in a square, with a reaction on one side (examples/nonlinear/surface-reaction.toml): error of
// y and time of a whole solve, by linear scenes on a device and on the host, and by marching on one core.
//
// With the reaction left out, one march of the linear scene is less work than any march of the nonlinear one with the
// same steps, which solves at least one such problem in each of them.

#include "bench/studies/nonlinear.hpp"

#include "app/commands.hpp"
#include "app/text.hpp"
#include "catalogue/recipes.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "nonlinear/solve_nonlinear.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

namespace bromwich::app {

namespace {

constexpr double c = 0.05, k = 2, s = 3;  // diffusivity, reaction, what is taken away
constexpr double useful = 1e-6;           // iteration tolerance far below the errors of the grids
constexpr double long_run = 3;            // seconds: one run instead of several
constexpr Index most_single_steps = 64;   // of method march: a window for each step

NonlinearScene surface_reaction(Index Q) {
  const double dx = 1 / double(Q + 1);
  NonlinearScene scene;
  scene.linear.dynamics = heat_with_boundary_value(Q, 2, c);
  scene.linear.M = Tridiagonal{Vector::Constant(Q, -1), Vector::Constant(Q, 4), Vector::Constant(Q, -1)};
  const Vector line = bump(Q), places = Vector::LinSpaced(Q, dx, double(Q) * dx);
  const Vector side = (std::numbers::pi * places.array()).sin();
  scene.linear.g = [side, dx](double t, Eigen::Ref<Vector> g) {
    g = -2 * dx * s * std::sin(2 * std::numbers::pi * t) * side;
  };
  scene.linear.x0.resize(Q * Q);
  for (Index i = 0; i < Q; ++i) scene.linear.x0.segment(i * Q, Q) = 2 * line[i] * line;
  scene.linear.breakpoints_are_all = true;  // none, as in the scenes of the catalogue
  scene.linear.T = 1.25;
  scene.of_trace = true;
  scene.gamma = [dx](double, const Eigen::Ref<const Vector>&, const Eigen::Ref<const Vector>& y,
                     Eigen::Ref<Vector> value) { value = 2 * dx * k * y.array().cube(); };
  scene.dgamma = [dx](double, const Eigen::Ref<const Vector>&, const Eigen::Ref<const Vector>& y,
                      Eigen::Ref<Matrix> by_v, Eigen::Ref<Matrix> by_y) {
    by_v.setZero();
    by_y = (6 * dx * k * y.array().square()).matrix().asDiagonal();
  };
  return scene;
}

// Largest difference at the time points of the coarser grid, from t = T/16 on.
double apart(const RowMatrix& coarse, const RowMatrix& fine) {
  const Index J = coarse.rows() - 1, ratio = (fine.rows() - 1) / J;
  double most = 0;
  for (Index j = (J + 15) / 16; j <= J; ++j)
    most = std::max(most, (coarse.row(j) - fine.row(ratio * j)).cwiseAbs().maxCoeff());
  return most;
}

class ReactionStudy {
 public:
  ReactionStudy(const BenchRequest& request, BenchReport& report, Index Q)
      : request_(request), report_(report), Q_(Q), scene_(surface_reaction(Q)) {}

  void make_reference(Backend& backend, Index J) {
    NonlinearOptions options;
    options.concurrent = true;
    options.steps = J / 2;
    const RowMatrix half = solve_nonlinear(scene_, backend, options).y;
    options.steps = J;
    const NonlinearResult r = solve_nonlinear(scene_, backend, options);
    if (r.status != Status::solved) throw Error("--backend", "the reference is not solved: " + r.reason, "look at it");
    reference_ = r.y;
    report_.details["error"] = fmt::format(
        "of y: the largest difference from {} steps at t >= T/16, which is known to {:.1e} by that of half as many", J,
        apart(half, reference_) / 3);
  }

  void nonlinear(const char* name, Backend& backend, Index J, NonlinearMethod method, Method inner, double tolerance) {
    NonlinearOptions options;
    options.concurrent = true;
    options.steps = J;
    options.method = method;
    options.inner = inner;
    options.tolerance = tolerance;
    NonlinearResult r;
    const std::vector<double> seconds = timed([&] { r = solve_nonlinear(scene_, backend, options); });
    add(name, backend, J, r.status, r.y, seconds,
        {{"tolerance", tolerance},
         {"reason", r.reason},
         {"linear_solves", r.solves},
         {"windows", r.windows},
         {"contraction", r.contraction},
         {"residual", r.residual}});
  }

  void linear(Backend& backend, Index J) {
    Options options;
    options.method = Method::march;
    options.steps = J;
    Result r;
    const std::vector<double> seconds = timed([&] { r = solve(scene_.linear, backend, options); });
    add("one linear march", backend, J, r.status, {}, seconds, {{"residual", r.residual}});
  }

  std::string text() const { return table(lines_); }

 private:
  std::vector<double> timed(const std::function<void()>& run) const {
    std::vector<double> seconds;
    for (int round = 0; round <= request_.repeats(); ++round) {  // the first one warms up
      Timer timer;
      run();
      seconds.push_back(timer.lap());
      if (seconds.back() > long_run) return {seconds.back()};
    }
    return {seconds.begin() + 1, seconds.end()};
  }

  void add(const char* name, Backend& backend, Index J, Status status, const RowMatrix& y,
           const std::vector<double>& seconds, Json row) {
    const double error = y.size() > 0 ? apart(y, reference_) : NAN;
    row.update({{"contestant", name},
                {"backend", backend.name()},
                {"threads", backend.device().threads},
                {"Q", Q_},
                {"steps", J},
                {"status", to_string(status)},
                {"seconds", spread(seconds)},
                {"repeats", seconds.size()}});
    if (y.size() > 0) row["error"] = error;
    lines_.push_back({name, backend.name(), fmt::format("{}", J), to_string(status), scientific(error),
                      row.contains("linear_solves") ? row["linear_solves"].dump() : "1",
                      format_seconds(median(seconds)), format_seconds(minimum(seconds))});
    report_.rows.push_back(std::move(row));
  }

  const BenchRequest& request_;
  BenchReport& report_;
  Index Q_;
  NonlinearScene scene_;
  RowMatrix reference_;
  std::vector<std::vector<std::string>> lines_{
      {"way", "backend", "J", "status", "error", "linear solves", "time", "fastest"}};
};

}  // namespace

BenchReport bench_nonlinear(const BenchRequest& request, Backend& backend) {
  refuse_scene(request);
  BenchReport report;
  report.scene = "surface-reaction";
  report.details["seconds"] = "wall clock of solve_nonlinear, or of solve for one linear march, everything in it";
  report.details["one linear march"] =
      "method march of the scene without the reaction: less work than any march of the nonlinear scene";
  report.details["iteration by marches"] = "method iteration with its linear scenes solved by method march";
  const Index Q = request.quick ? 63 : 511;
  const std::vector<Index> grids = request.quick ? std::vector<Index>{32, 64} : std::vector<Index>{64, 256, 1024, 4096};
  const auto one_core = make_cpu_backend(1);
  std::unique_ptr<Backend> device;
  if (!cuda_devices().empty()) device = make_cuda_backend(make_cpu_backend(backend.device().threads));
  if (device) report.parameters = {{"device", device->device().name}};
  ReactionStudy study(request, report, Q);
  study.make_reference(device ? *device : backend, 4 * grids.back());
  for (const Index J : grids) {
    for (const double tolerance : {1e-12, useful}) {
      if (device) study.nonlinear("iteration", *device, J, NonlinearMethod::iteration, Method::automatic, tolerance);
      study.nonlinear("iteration by marches", *one_core, J, NonlinearMethod::iteration, Method::march, tolerance);
    }
    study.nonlinear("iteration", backend, J, NonlinearMethod::iteration, Method::automatic, useful);
    study.linear(*one_core, J);
    if (J <= most_single_steps)
      study.nonlinear("march", *one_core, J, NonlinearMethod::march, Method::automatic, useful);
  }
  print(fmt::format("whole solves, Q = {}\n{}", Q, study.text()));
  return report;
}

}  // namespace bromwich::app
