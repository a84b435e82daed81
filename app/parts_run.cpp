#include "app/parts_run.hpp"

#include "app/part_solver.hpp"
#include "app/ranks.hpp"
#include "app/text.hpp"
#include "app/times_of_run.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/scene/separable.hpp"
#include "core/solve/solver.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <utility>

namespace bromwich::app {

namespace {

constexpr Index values_per_part = 1 << 22;  ///< 32 MiB of states and constraints: parts must not fill the memory
constexpr Index fewest_steps = 16;          ///< of a part: shorter ones are mostly set-up
constexpr Index first_steps = 64;           ///< of the first part, of which nobody knows how long it takes
constexpr Index divided_steps = 256;        ///< of a rank in the first part of a method over all time points
constexpr Index values_together = 1 << 25;  ///< 256 MiB in a part of such a method, whose steps share the work
constexpr Index few_states = 64;            ///< recorded at all time points, as those at the end are needed
constexpr double share_of_interval = 0.25;  ///< of the time between checkpoints that a part is to take
constexpr double most_growth = 256;         ///< of the steps of a part: the set-up hides how long its steps take
/// How well y at the start of a part, found from x alone, must agree with y of the step before.
constexpr double same_y = 1e-6;

/// Growth of perturbations over all parts at which rounding is no longer far below the usual tolerances.
constexpr double much_growth = 1e6;

/// Whether a method treats all time points of a part together. Ranks share them.
bool together(Method method) { return method == Method::contour || method == Method::multigrid; }

/// Rows of a part with a value, without a gap.
Index valid_steps(const Result& part) {
  Index row = 0;
  while (row + 1 < part.t.size() && row + 1 < part.y.rows() && part.y.row(row + 1).allFinite() &&
         part.x.row(row + 1).allFinite())
    ++row;
  return row;
}

double maximum(double a, double b) { return std::isnan(a) ? b : std::isnan(b) ? a : std::max(a, b); }

/// Adds the counters and errors of a part to those of the run.
void add(Result& total, const Result& part, bool first) {
  total.residual = maximum(total.residual, part.residual);
  total.kernel_error = maximum(total.kernel_error, part.kernel_error);
  total.unresolved_sources = std::max(total.unresolved_sources, part.unresolved_sources);
  total.rough_steps += part.rough_steps;
  total.iterations += part.iterations;
  total.lcp += part.lcp;
  total.seconds = total.seconds + part.seconds;
  total.bytes = std::max(total.bytes, part.bytes);
  total.bytes_predicted = std::max(total.bytes_predicted, part.bytes_predicted);
  total.well_posed = total.well_posed && part.well_posed;
  total.continuous = part.continuous;
  total.method = part.method;
  total.backend = part.backend;
  total.kernel = part.kernel;
  total.magnification = first ? part.magnification : total.magnification * part.magnification;
  if (!part.warning.empty()) add_warning(total, part.warning);
  if (total.magnification > much_growth)
    add_warning(total, "each part of the run is certified on its own, and perturbations grow from part to part");
}

class PartsRun {
 public:
  PartsRun(const Scene& scene, Backend& backend, const Options& options, const PartsOptions& parts, ResultOutput* out)
      : scene_(scene),
        options_(options),
        parts_(parts),
        out_(out),
        components_(recorded_components(scene, options)),
        boundaries_(scene, options.steps),
        solver_(scene, backend, of_part(scene, options, out, [this] { return state_.row; })),
        backend_(backend) {
    choose_lengths();
    state_ = {parts.run, parts.scene, 0, options.steps, 0, scene.x0, {}, {}};
    if (parts.from) state_ = *parts.from;
    for (const auto& [name, fact] : state_.totals) {
      const double value = std::get<double>(fact);
      if (name == "residual") total_.residual = value;
      if (name == "kernel_error") total_.kernel_error = value;
      if (name == "iterations") total_.iterations = Index(value);
      if (name == "seconds") total_.seconds.total = value;
    }
    start_ = saved_row_ = state_.row;
    total_.status = Status::solved;
    total_.steps = options.steps;
  }

  Result run() {
    while (state_.row < options_.steps && total_.status == Status::solved) advance();
    if (parts_.checkpoint && saved_row_ != state_.row) save();
    return std::move(total_);
  }

 private:
  /// All states of a few are recorded. Of many, those at the end of a part are computed from y, where that can be.
  /// Steps of the part that begins at row `begin()` are reported as those of the run.
  static Options of_part(const Scene& scene, const Options& options, const ResultOutput* out,
                         std::function<Index()> begin) {
    Options changed = options;
    changed.trace = out && out->with_slack();
    if (options.progress)
      changed.progress = [report = options.progress, begin = std::move(begin), steps = options.steps](Progress p) {
        if (p.total > 0) p = {begin() + p.iteration, p.change, steps};
        report(p);
      };
    if (options.method != Method::euler && scene.states() > few_states) return changed;
    changed.states = StateSelection::all;
    changed.components.clear();
    return changed;
  }

  /// The whole state at the end of a part that is solved.
  Vector state_at_end(Result& part, Index steps) {
    if (Index(part.x_components.size()) < scene_.states() && part.continuous) {
      try {
        return states_at(solver_.part(), backend_, part, {steps}).col(0);
      } catch (const Error&) {  // not every kernel can compute states afterwards
      }
    }
    if (Index(part.x_components.size()) < scene_.states()) {
      solver_.record_all();
      part = solver_.solve_again();
    }
    return part.x.row(steps).transpose();
  }

  /// Steps of a part that fill the memory which a part may take.
  Index steps_that_fit(Index values) const {
    return values / std::max<Index>(1, solver_.recorded() + 2 * scene_.constraints());
  }

  /// Parts of a method over all time points are worth dividing among the ranks, and halve often.
  void choose_lengths() {
    if (!together(options_.method)) {
      next_steps_ = std::min(first_steps, std::max(fewest_steps, steps_that_fit(values_per_part)));
      return;
    }
    next_steps_ = Index(std::bit_ceil(std::size_t(divided_steps * ranks().size())));
    shortest_ = next_steps_ / 2;
  }

  /// The last part takes a rest with it that would be too short.
  Index end_of_part(Index begin) const {
    const Index end = boundaries_.from(begin + next_steps_);
    return options_.steps - end < shortest_ ? options_.steps : end;
  }

  void advance() {
    const Index begin = state_.row, end = end_of_part(begin), steps = end - begin;
    const double t = boundaries_.time(begin);
    note(options_.log, LogLevel::debug, "part of %ld steps from t = %.6g on", long(steps), t);
    Result part = solver_.solve({scene_.T, options_.steps, begin, boundaries_.time(end) - t, steps}, state_.x);
    const Index valid = valid_steps(part);
    const bool first = begin == 0;
    add(total_, part, begin == start_);
    if (!first && part.status != Status::interrupted && !continues(part)) {
      total_.status = Status::unsupported;
      total_.reason = fmt::format(
          "at t = {:.10g} y does not follow from x alone, and the run cannot be divided there; use --method euler, or "
          "run "
          "it without --checkpoint",
          t);
      return finish(std::move(part), begin, 0);
    }
    refuse_memory_of_steps(part);
    if (first) total_.starts_with_impulse = part.starts_with_impulse;
    total_.status = part.status;
    if (part.status == Status::interrupted)  // the part counts time from its own start
      total_.reason =
          fmt::format("stopped on request at t = {:.10g}", boundaries_.time(begin + std::max<Index>(valid, 0)));
    else if (part.status != Status::solved)
      total_.reason = fmt::format("{} (in the part from t = {:.10g} on)", part.reason, t);
    if (part.infeasible_at) total_.infeasible_at = t + *part.infeasible_at;
    if (part.status == Status::solved) state_.x = state_at_end(part, steps);
    write(part, begin, first ? 0 : 1, valid);
    if (part.status == Status::solved) {
      state_.row = end;
      state_.t = boundaries_.time(end);
      state_.y = part.y.row(steps).transpose();
    }
    double seconds = clock_.lap();
    ranks().broadcast(&seconds, 1, 0);  // clocks differ
    since_save_ += seconds;
    choose_steps(seconds, steps);
    if (parts_.checkpoint && part.status == Status::solved && since_save_ >= parts_.seconds) save();
    finish(std::move(part), begin, valid);
  }

  /// Radau IIA takes steps after a jump of the state by other rules, so that a step depends on those before.
  void refuse_memory_of_steps(const Result& part) const {
    if (options_.method == Method::euler || part.continuous) return;
    throw Error(parts_.checkpoint ? "--checkpoint" : "--restart",
                fmt::format("M leaves y to the dynamics, where a step of method {} depends on those before it",
                            to_string(options_.method)),
                "use --method euler, or run it without checkpoints");
  }

  bool continues(const Result& part) const {
    if (options_.method == Method::euler || state_.y.size() == 0) return true;  // it does not use y at the start
    if (part.starts_with_impulse) return false;
    const double largest = state_.y.cwiseAbs().maxCoeff(),
                 distance = (part.y.row(0).transpose() - state_.y).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
    return distance <= same_y * std::max(1.0, largest);
  }

  /// Rows `first` to `last` of the part.
  void write(const Result& part, Index begin, Index first, Index last) {
    if (part.status != Status::solved && part.y.rows() > 0 && !part.y.row(0).allFinite() && last == 0) last = -1;
    if (!out_ || last < first) return;
    Vector t(last - first + 1);
    for (Index j = first; j <= last; ++j) t[j - first] = boundaries_.time(begin + j);
    out_->append(solver_.part(), part, t, first, last);
  }

  /// Keeps the arrays of the last part, with the times of the run.
  void finish(Result part, Index begin, Index valid) {
    total_.t.resize(valid + 1);
    for (Index j = 0; j <= valid; ++j) total_.t[j] = boundaries_.time(begin + j);
    total_.y = part.y.rows() > valid ? RowMatrix(part.y.topRows(valid + 1)) : RowMatrix();
    total_.x_components = components_;
    const bool all = part.x_components.size() != components_.size();
    const Index rows = std::min<Index>(valid + 1, part.x.rows());
    total_.x = all ? RowMatrix(part.x.topRows(rows)(Eigen::all, components_)) : RowMatrix(part.x.topRows(rows));
  }

  /// Longer parts where the last one took less than half of its share of the interval. Each length has a set-up.
  void choose_steps(double seconds, Index steps) {
    const double share = share_of_interval * parts_.seconds;
    if (steps != next_steps_ || seconds >= share / 2) return;
    if (together(options_.method)) {
      const Index most = Index(std::bit_floor(std::size_t(steps_that_fit(values_together))));
      next_steps_ = std::max(next_steps_, std::min(2 * next_steps_, most));
    } else {
      const Index wanted = Index(double(steps) * std::min(most_growth, share / seconds));
      next_steps_ = std::max(next_steps_, std::min(wanted, steps_that_fit(values_per_part)));
    }
  }

  void save() {
    if (out_) out_->flush();  // before the checkpoint: a restart needs these rows
    state_.totals = {{"residual", total_.residual},
                     {"kernel_error", total_.kernel_error},
                     {"iterations", double(total_.iterations)},
                     {"seconds", total_.seconds.total}};
    if (first_rank()) write_checkpoint({"--checkpoint", parts_.checkpoint->target()}, state_);
    saved_row_ = state_.row;
    since_save_ = 0;
  }

  const Scene& scene_;
  const Options& options_;
  const PartsOptions& parts_;
  ResultOutput* out_;
  std::vector<Index> components_;
  Boundaries boundaries_;
  PartSolver solver_;
  Backend& backend_;
  Index next_steps_ = 0, shortest_ = 0, start_ = 0, saved_row_ = -1;
  Checkpoint state_;
  Result total_;
  Timer clock_;
  double since_save_ = 0;  ///< seconds
};

}  // namespace

void prepare_parts(const std::string& argument, const Scene& scene, Options& options) {
  const auto refuse = [&](const std::string& found, const std::string& remedy) {
    throw Error(argument, found, remedy);
  };
  if (controls_error(options))
    refuse("a tolerance looks at the whole run and solves it on several grids", "give --steps instead of --tol");
  if (scene.boundary) refuse("a scene with boundary values is no run from the start to the end", "leave it out");
  if (!scene.memories.empty()) refuse("a checkpoint has no modes of memories", "leave it out");
  if (options.method == Method::automatic && ranks().size() == 1) options.method = Method::march;
  const std::initializer_list<Method> in_parts{Method::march, Method::euler, Method::contour, Method::multigrid};
  if (std::find(in_parts.begin(), in_parts.end(), options.method) == in_parts.end())
    refuse(
        fmt::format("method {} is no run from the start to the end", to_string(options.method)),
        ranks().size() == 1 ? "use --method march, euler, contour or multigrid" : "use --method contour or multigrid");
  options.steps = steps_of(scene, options);
}

void read_restart(const std::string& file, PartsOptions& parts) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none))
    throw Error("--restart", fmt::format("the file '{}' does not exist", file), "give a file of --checkpoint");
  Checkpoint found = read_checkpoint({"--restart", file});
  if (found.scene != parts.scene)
    throw Error("--restart", fmt::format("the checkpoint is of {}, and this run is {}", found.scene, parts.scene),
                "give the scene and the options of the run that wrote it");
  if (found.row >= found.steps)
    throw Error("--restart", fmt::format("the run of '{}' has reached its end", file), "start without --restart");
  parts.run = found.run;
  parts.from = std::move(found);
}

void append_start(const Scene& scene, const Checkpoint& checkpoint, ResultOutput& out) {
  Result row;
  row.status = Status::solved;
  row.t = Vector::Constant(1, checkpoint.t);
  row.y = checkpoint.y.transpose();
  row.x = checkpoint.x.transpose();
  for (Index i = 0; i < scene.states(); ++i) row.x_components.push_back(i);
  row.trace = observe(scene.dynamics, checkpoint.x).transpose();
  out.append(scene, row, row.t, 0, 0);
}

Result solve_in_parts(const Scene& scene, Backend& backend, const Options& options, const PartsOptions& parts,
                      ResultOutput* out) {
  return PartsRun(scene, backend, options, parts, out).run();
}

}  // namespace bromwich::app
