#include "batch/single_solves.hpp"

#include "batch/batch_groups.hpp"
#include "core/base/error.hpp"
#include "core/march/impact_rows.hpp"
#include "core/result/slack.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

// Errors of the options and of the machine are not those of one scene.
bool of_one_scene(const Error& error) {
  constexpr const char* options[] = {"steps",          "states",        "method",      "iteration_tolerance",
                                     "max_iterations", "memory_limit",  "max_seconds", "max_steps",
                                     "event_location", "first_iterate", "backend",     "algebraic_share"};
  return error.kind() == ErrorKind::bad_input &&
         std::none_of(std::begin(options), std::end(options), [&](const char* o) { return error.argument() == o; });
}

Eigen::Block<RowMatrix> rows_of(const BatchResult& r, RowMatrix& all, Index k) {
  return all.rows() > 0 ? all.block(k * r.rows(), 0, r.rows(), all.cols()) : all.block(0, 0, 0, 0);
}

}  // namespace

void clear_rows(BatchResult& r, Index k) {
  for (RowMatrix* all : {&r.y, &r.w, &r.x}) rows_of(r, *all, k).setConstant(NAN);
}

SingleSolves::SingleSolves(const Batch& batch, Backend& backend, const Options& options, BatchResult& result)
    : batch_(batch), backend_(backend), options_(options), result_(result), own_sources_(own_sources(batch)) {}

void SingleSolves::take(Index k, bool shares) {
  try {
    const Scene scene = scene_of(batch_, k);
    const bool by_solver = shares && !scene.boundary && !scene.port;
    write(k, scene, with_rows(scene, by_solver ? solved_by_solver(scene) : solve(scene, backend_, options_of(scene))));
  } catch (const Error& error) {
    if (!of_one_scene(error)) throw;
    clear_rows(result_, k);
    result_.status[std::size_t(k)] = Status::unsupported;
    result_.reason[std::size_t(k)] = error.what();
    forget();
  }
}

Options SingleSolves::options_of(const Scene& scene) const {
  Options options = options_;
  if (!options.confirm || controls_error(options)) return options;
  const std::optional<ImpactRows> rows = impact_rows(scene);
  options.confirm = !rows || !rows->have_one_solution();
  return options;
}

Result SingleSolves::solved_by_solver(const Scene& scene) {
  scene.validate();
  NaturalUnits units = natural_units(scene);
  const auto found =
      std::find_if(solvers_.begin(), solvers_.end(), [&](const UnitSolver& s) { return same_units(s.units, units); });
  if (found == solvers_.end()) {
    if (solvers_.size() >= most_solvers) solvers_.erase(solvers_.begin());
    solvers_.push_back({std::move(units), std::make_unique<Solver>(scene, backend_, options_of(scene))});
    return solvers_.back().solver->solve();
  }
  found->solver->set_x0(scene.x0);
  if (own_sources_) found->solver->set_sources(scene.f, scene.g, scene.breakpoints, scene.breakpoints_are_all);
  ++prepared_;
  return found->solver->solve();
}

// At the times of the batch, if it has some.
Result SingleSolves::with_rows(const Scene& scene, Result result) const {
  if (batch_.times.empty()) return result;
  const double T = first_of(batch_).T;
  std::vector<double> times = batch_.times;
  for (double& t : times)
    if (scene.T != T) t = std::min(t / T * scene.T, scene.T);
  if (result.y.rows() == result.steps + 1) return at_times(scene, backend_, result, times);
  const Index rows = Index(times.size());  // a solve that ended before its first row
  result.t = Eigen::Map<const Vector>(times.data(), rows);
  result.y = RowMatrix::Constant(rows, scene.constraints(), NAN);
  result.x = RowMatrix::Constant(rows, Index(result_.x_components.size()), NAN);
  result.trace.resize(0, 0);
  return result;
}

void SingleSolves::write(Index k, const Scene& scene, const Result& result) {
  rows_of(result_, result_.y, k) = result.y;
  if (result_.w.size() > 0) {
    const RowMatrix w = slack(scene, result);
    if (w.rows() == result_.rows())
      rows_of(result_, result_.w, k) = w;
    else
      rows_of(result_, result_.w, k).setConstant(NAN);
  }
  if (result_.x.size() > 0) rows_of(result_, result_.x, k) = result.x;
  result_.status[std::size_t(k)] = result.status;
  result_.reason[std::size_t(k)] = result.reason;
  result_.warning[std::size_t(k)] = result.warning;
  result_.method[std::size_t(k)] = result.method;
  result_.residual[k] = result.residual;
  result_.infeasible_at[std::size_t(k)] = result.infeasible_at.value_or(NAN);
}

}  // namespace bromwich
