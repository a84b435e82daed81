// Contact on one side of a square with a conductivity that varies by a factor of fifty: sparse dynamics with m = Q^2
// states and n = Q contacts, M = 0 or a compliance of 1e-2. `march` beside the sparse implicit Euler of
// bench/studies/sparse_euler.hpp, with 1000 steps each, and with the fewest steps of a ladder for which both errors,
//
//     w:  max |w - w_ref| / max |w_ref|,     y:  mean |y - y_ref| / mean |y_ref|,
//
// over the time points of both grids are below 1e-3. The reference is march with more steps. 10^6 states are solved on
// request: once by both with equal steps, where the errors of the Euler are differences from that march, or, if steps
// of both are given, at equal error, too, with a reference and no ladder.

#include "app/commands.hpp"
#include "app/text.hpp"
#include "bench/studies/sparse_euler.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

namespace bromwich::app {

namespace {

constexpr double end_time = 4;

struct Size {
  Index cells;
  Index reference, steps;  ///< steps of the reference, and of both at equal steps
  double wanted;           ///< error
  int repeats;
  Index of_march = 0, of_euler = 0;  ///< steps at equal error, 0: searched on the ladder

  bool once() const { return reference == 0; }  ///< both with `steps`, no other run
};

// A layered material with an inclusion, as in scripts/make_contact_scene.
double conductivity(double x, double y) {
  const double layer = 0.05 * std::pow(10, 0.5 * std::sin(7 * x + 3 * y));
  return (x - 0.4) * (x - 0.4) + (y - 0.6) * (y - 0.6) < 0.04 ? 0.2 * layer : layer;
}

SparseMatrix conduction(Index Q) {
  std::vector<Eigen::Triplet<double>> entries;
  const double scale = double(Q + 1) * double(Q + 1);
  const auto place = [Q](double i) { return (i + 1) / double(Q + 1); };
  const auto join = [&](Index a, Index b, double joint) {
    entries.emplace_back(a, b, joint);
    entries.emplace_back(b, a, joint);
    entries.emplace_back(a, a, -joint);
    entries.emplace_back(b, b, -joint);
  };
  for (Index i = 0; i < Q; ++i)
    for (Index k = 0; k < Q; ++k) {
      const Index cell = i * Q + k;
      const double x = place(double(k)), y = place(double(i)), half = 0.5 / double(Q + 1);
      if (i + 1 < Q) join(cell, cell + Q, scale * conductivity(x, y + half));
      if (k + 1 < Q) join(cell, cell + 1, scale * conductivity(x + half, y));
      if (k == Q - 1) entries.emplace_back(cell, cell, -2 * scale * conductivity(1, y));
    }
  SparseMatrix A(Q * Q, Q * Q);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

Scene field(Index Q, double compliance) {
  SparseDynamics d{conduction(Q), SparseMatrix(Q * Q, Q), SparseMatrix(Q, Q * Q)};
  for (Index i = 0; i < Q; ++i) {
    d.B.insert(i * Q, i) = double(Q + 1);
    d.N.insert(i, i * Q) = 1;
  }
  d.B.makeCompressed();
  d.N.makeCompressed();
  Scene scene;
  scene.name = "contact-varying";
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Zero(Q), Vector::Constant(Q, compliance), Vector::Zero(Q)};
  scene.g = [Q](double t, Eigen::Ref<Vector> g) {
    const double grown = 1 - std::exp(-5 * t);
    for (Index i = 0; i < Q; ++i) {
      const double x = double(i + 1) / double(Q + 1), pi = std::numbers::pi;
      g[i] = grown *
             (0.5 * std::sin(pi * x) * (1 + 0.5 * std::cos(5 * x)) * std::sin(3 * t) + 0.05 * std::sin(7 * pi * x));
    }
  };
  scene.x0 = Vector::Zero(Q * Q);
  scene.T = end_time;
  return scene;
}

struct FieldRun {
  std::string status = "not solved", kernel;
  RowMatrix y, w;
  double setup = 0, total = 0, kernel_error = 0;
  std::size_t bytes = 0;
  Index steps = 0, euler_steps = 0;
};

// Whether a run that begins now has taken so many seconds; 0: no limit.
std::function<bool()> after(double seconds) {
  if (!(seconds > 0)) return {};
  using Clock = std::chrono::steady_clock;
  return
      [seconds, start = Clock::now()] { return std::chrono::duration<double>(Clock::now() - start).count() > seconds; };
}

FieldRun by_march(const Scene& scene, Backend& backend, Index steps, double limit) {
  Options options;
  options.method = Method::march;
  options.steps = steps;
  options.trace = true;
  options.interrupted = after(limit);
  Result r = solve(scene, backend, options);
  FieldRun run{to_string(r.status), r.kernel, std::move(r.y), std::move(r.trace), r.seconds.setup, r.seconds.total,
               r.kernel_error,      r.bytes,  steps,          r.euler_steps};
  Vector g(scene.constraints());
  for (Index j = 0; j < run.w.rows(); ++j) {
    scene.g(r.t[j], g);
    run.w.row(j) += (g + multiply(scene.M, Vector(run.y.row(j).transpose()))).transpose();
  }
  return run;
}

FieldRun by_euler(const Scene& scene, Index steps, double limit) {
  SparseEuler r = solve_by_sparse_euler(scene, steps, after(limit));
  FieldRun run;
  if (r.solved) run.status = "solved";
  run.kernel = fmt::format("L D L^T with {} entries, contact states last", r.factor_entries);
  run.y = std::move(r.y);
  run.w = std::move(r.w);
  run.setup = r.setup;
  run.total = r.setup + r.solve;
  run.bytes = r.bytes;
  run.steps = steps;
  return run;
}

struct FieldErrors {
  double w = NAN, y = NAN;
  double largest() const { return std::max(w, y); }
};

// Without row 0, where y of M = 0 is not determined. NaN if one of them did not end.
FieldErrors errors(const FieldRun& run, const FieldRun& reference) {
  if (run.status != "solved" || reference.status != "solved") return {};
  const Index common = std::gcd(run.steps, reference.steps), a = run.steps / common, b = reference.steps / common;
  double w = 0, y = 0, all = 0;
  for (Index k = 1; k <= common; ++k) {
    w = std::max(w, (run.w.row(k * a) - reference.w.row(k * b)).cwiseAbs().maxCoeff());
    y += (run.y.row(k * a) - reference.y.row(k * b)).cwiseAbs().sum();
    all += reference.y.row(k * b).cwiseAbs().sum();
  }
  return {w / reference.w.cwiseAbs().maxCoeff(), y / all};
}

// 100, 125, 160, 200, ...: common points with a reference of 1000 2^k steps.
std::vector<Index> ladder(Index largest) {
  std::vector<Index> steps;
  for (Index tens = 100;; tens *= 10)
    for (const Index part : {100, 125, 160, 200, 250, 320, 400, 500, 640, 800}) {
      if (tens * part / 100 > largest) return steps;
      steps.push_back(tens * part / 100);
    }
}

class FieldStudy {
 public:
  FieldStudy(BenchReport& report, Backend& backend, double limit) : report_(report), backend_(backend), limit_(limit) {}

  void run(const Size& size, double compliance) {
    const Scene scene = field(size.cells, compliance);
    const Solver march = [&](Index steps) { return by_march(scene, backend_, steps, limit_); },
                 euler = [&](Index steps) { return by_euler(scene, steps, limit_); };
    if (size.once()) {
      at_ = "equal steps";
      known_ = {};
      add("march", march, size.steps, size, compliance, {});
      const FieldRun of_march = std::move(last_);
      add("sparse euler", euler, size.steps, size, compliance, of_march);
      return;
    }
    const FieldRun reference = march(size.reference);
    known_ = errors(march(size.reference / 2), reference);
    from_euler_ = size.cells > 64 ? NAN : difference_from_euler(scene, euler(size.steps));
    at_ = "equal steps";
    add("march", march, size.steps, size, compliance, reference);
    add("sparse euler", euler, size.steps, size, compliance, reference);
    at_ = "equal error";
    const Index steps = size.of_march > 0 ? size.of_march : fewest(march, 2, size, reference),
                steps_of_euler = size.of_euler > 0 ? size.of_euler : fewest(euler, 1, size, reference);
    const double of_march = add("march", march, steps, size, compliance, reference),
                 of_euler = add("sparse euler", euler, steps_of_euler, size, compliance, reference);
    report_.notes.push_back(fmt::format(
        "m = {}, n = {}, compliance {:g}, error {:g}: march {}, sparse Euler {}, ratio {:.1f}", size.cells * size.cells,
        size.cells, compliance, size.wanted, format_seconds(of_march), format_seconds(of_euler), of_euler / of_march));
  }

  std::string text() const { return table(lines_); }

 private:
  using Solver = std::function<FieldRun(Index)>;

  // The first of the ladder with both errors below the wanted one; those at which a method of this order would still
  // miss it by a factor of 1.25 are left out.
  static Index fewest(const Solver& solver, double order, const Size& size, const FieldRun& reference) {
    const std::vector<Index> all = ladder(size.reference / 2);
    for (std::size_t k = 0; k < all.size(); ++k) {
      const double error = errors(solver(all[k]), reference).largest(), steps = double(all[k]);
      if (error <= size.wanted) return all[k];
      const double needed = steps * std::pow(error / (1.25 * size.wanted), 1 / order);
      while (k + 2 < all.size() && double(all[k + 1]) < needed) ++k;
    }
    throw Error("fields", fmt::format("no grid of up to {} steps reaches {:g}", all.back(), size.wanted), "");
  }

  double difference_from_euler(const Scene& scene, const FieldRun& run) const {
    Options options;
    options.method = Method::euler;
    options.steps = run.steps;
    const Result r = solve(scene, backend_, options);
    return (r.y - run.y).bottomRows(run.steps).cwiseAbs().maxCoeff() / run.y.maxCoeff();
  }

  double add(const char* contestant, const Solver& solver, Index steps, const Size& size, double compliance,
             const FieldRun& reference) {
    Samples samples;
    FieldRun run;
    for (int round = 0; round < size.repeats; ++round) {
      run = solver(steps);
      samples.add(run.total, run.setup, run.total - run.setup);
    }
    const FieldErrors e = errors(run, reference);
    const double contact = double((run.y.array() > 0).count()) / double(run.y.size());
    report_.rows.push_back({{"contestant", contestant},
                            {"at", at_},
                            {"parameters", {{"cells", size.cells}, {"compliance", compliance}}},
                            {"states", size.cells * size.cells},
                            {"constraints", size.cells},
                            {"steps", steps},
                            {"status", run.status},
                            {"kernel", run.kernel},
                            {"kernel_error", run.kernel_error},
                            {"euler_steps", run.euler_steps},
                            {"contact_share", contact},
                            {"error_w_max", e.w},
                            {"error_y_mean", e.y},
                            {"reference_steps", size.reference},
                            {"reference_known_to", {{"w_max", known_.w}, {"y_mean", known_.y}}},
                            {"difference_from_euler", from_euler_},
                            {"repeats", size.repeats},
                            {"seconds", to_json(samples)},
                            {"bytes", run.bytes}});
    lines_.push_back({fmt::format("{}", size.cells * size.cells), fmt::format("{:g}", compliance), at_, contestant,
                      fmt::format("{}", steps), scientific(e.w), scientific(e.y), format_seconds(median(samples.total)),
                      format_seconds(median(samples.setup)), format_bytes(double(run.bytes)), run.status});
    last_ = std::move(run);
    return median(samples.total);
  }

  BenchReport& report_;
  Backend& backend_;
  double limit_;   ///< seconds a run, 0: none
  FieldRun last_;  ///< of `add`
  FieldErrors known_;
  double from_euler_ = NAN;
  std::string at_;
  std::vector<std::vector<std::string>> lines_{
      {"m", "compliance", "at", "contestant", "steps", "error w", "error y", "total", "setup", "memory", "status"}};
};

}  // namespace

BenchReport bench_fields(const BenchRequest& request, Backend& backend) {
  if (request.scene) throw Error("SCENE", "this benchmark has its own scene", "leave it out");
  Index only = 0, of_march = 0, of_euler = 0;
  std::optional<double> compliance;
  double limit = 0;
  for (const auto& [name, value] : request.settings) {
    if (name == "cells")
      only = Index(value);
    else if (name == "march")
      of_march = Index(value);
    else if (name == "euler")
      of_euler = Index(value);
    else if (name == "compliance")
      compliance = value;
    else if (name == "limit")
      limit = value;
    else
      throw Error(
          "--set", fmt::format("found '{}'", name),
          "use cells, along a side; compliance; march and euler, their steps at equal error; limit, seconds a run");
  }
  BenchReport report;
  report.scene = "contact-varying";
  report.parameters = {{"T", end_time}};
  report.details["error_w_max"] = "largest difference of w from the reference, over the largest w";
  report.details["error_y_mean"] = "mean difference of y from the reference, over the mean of y";
  report.details["reference"] = "march with reference_steps; reference_known_to: the same with half of them";
  report.details["seconds"] = "wall clock of the whole solve; march may count its shifted solves in solve";
  report.details["equal error"] =
      "the fewest steps of a ladder (factor 1.25) that keep both errors below 1e-3, or those given";
  report.details["difference_from_euler"] =
      "y of the sparse Euler against method euler of the solver, small sizes only";
  std::vector<Size> sizes = request.quick ? std::vector<Size>{{32, 2000, 200, 2e-2, 1}}
                                          : std::vector<Size>{{100, 16000, 1000, 1e-3, request.repeats()},
                                                              {316, 8000, 1000, 1e-3, std::min(2, request.repeats())}};
  if (only == 1000) sizes = {{1000, of_march > 0 && of_euler > 0 ? 8000 : 0, 1000, 1e-3, 1}};
  if (only > 0 && std::none_of(sizes.begin(), sizes.end(), [&](const Size& size) { return size.cells == only; }))
    throw Error("--set", fmt::format("found cells={}", only), "use 100, 316 or 1000, and 32 with --quick");
  FieldStudy study(report, backend, limit);
  for (Size size : sizes) {
    if (only > 0 && size.cells != only) continue;
    if (request.steps > 0) size.steps = request.steps;
    size.of_march = of_march;
    size.of_euler = of_euler;
    if (of_march > 0 && of_euler > 0) size.reference /= 2;  // no ladder, which needs a longer one
    for (const double value : {0.0, 1e-2})
      if (!compliance || *compliance == value) study.run(size, value);
  }
  print_with_notes(study.text(), report);
  return report;
}

}  // namespace bromwich::app
