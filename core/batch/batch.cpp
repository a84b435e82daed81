#include "core/batch/batch.hpp"

#include "core/base/error.hpp"
#include "core/base/require.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/batch/lane_march.hpp"
#include "core/result/slack.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/scaling.hpp"
#include "core/solve/solver.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

constexpr Index lanes = 8;
constexpr Index groups_between_polls = 16;  ///< of lanes, for each thread
constexpr double most_lane_bytes = 256e6;   ///< of the buffers of one thread
constexpr Index fewest_in_lanes = 2;        ///< scenes of a group
constexpr double default_block_bytes = 1e9;
constexpr Index most_steps = Index(1) << 24;  ///< as core/solve/solve.cpp

// Errors of the options and of the machine are not those of one scene.
bool of_one_scene(const Error& error) {
  constexpr const char* options[] = {"steps",          "states",        "method",      "iteration_tolerance",
                                     "max_iterations", "memory_limit",  "max_seconds", "max_steps",
                                     "event_location", "first_iterate", "backend",     "algebraic_share"};
  return error.kind() == ErrorKind::bad_input &&
         std::none_of(std::begin(options), std::end(options), [&](const char* o) { return error.argument() == o; });
}

template <class Entries>
void require_axis(const std::string& member, const Entries& entries, Index scenes) {
  if (!entries.empty() && Index(entries.size()) != scenes)
    throw Error(member, "has " + std::to_string(entries.size()) + " entries",
                "give " + std::to_string(scenes) + ", one per scene, or none");
}

void require_matrices(const std::string& member, const std::vector<Matrix>& all, Index rows, Index cols) {
  for (std::size_t k = 0; k < all.size(); ++k)
    require_shape(member + " of scene " + std::to_string(k), all[k], rows, cols, "the shape that all scenes have");
}

Index steps_of(const Scene& scene, const Options& options) {
  return options.steps > 0 ? options.steps : scene.default_steps;
}

const Scene& first_of(const Batch& b) { return b.own.empty() ? b.common : b.own.front(); }

bool own_matrices(const Batch& b) {
  return !b.A.empty() || !b.B.empty() || !b.N.empty() || !b.M.empty() || !b.E.empty();
}
bool own_sources(const Batch& b) {
  return !b.f.empty() || !b.g.empty() || !b.breakpoints.empty() ||
         std::any_of(b.own.begin(), b.own.end(), [](const Scene& s) { return s.f || s.g; });
}

bool same_matrix(const LcpMatrix& a, const LcpMatrix& b) {
  if (a.index() != b.index()) return false;
  const auto *p = std::get_if<Matrix>(&a), *q = std::get_if<Matrix>(&b);
  return p && q && p->rows() == q->rows() && p->cols() == q->cols() && *p == *q;
}

bool same_values(const Matrix& a, const Matrix& b) { return a.rows() == b.rows() && a.cols() == b.cols() && a == b; }

bool same_dynamics(const Dynamics& a, const Dynamics& b) {
  if (&*a == &*b) return true;
  const auto *p = a->small_state(), *q = b->small_state();
  return p && q && same_values(p->A, q->A) && same_values(p->B, q->B) && same_values(p->N, q->N) &&
         same_values(p->E, q->E);
}

// Equal for dense dynamics with equal values; others are told apart by their place.
std::size_t hash_of(const Dynamics& dynamics) {
  const DenseDynamics* dense = dynamics->small_state();
  if (!dense) return std::hash<const void*>()(&*dynamics);
  std::size_t hash = 0;
  for (const Matrix* matrix : {&dense->A, &dense->B, &dense->N, &dense->E})
    for (Index k = 0; k < matrix->size(); ++k) hash = hash * 1099511628211u + std::hash<double>()(matrix->data()[k]);
  return hash;
}

// Scenes that differ in x0, f and g at most.
bool share_preparation(const Scene& a, const Scene& b) {
  return same_dynamics(a.dynamics, b.dynamics) && a.lcp_class == b.lcp_class && a.T == b.T &&
         a.default_steps == b.default_steps && a.f_entry == b.f_entry && bool(a.f) == bool(b.f) &&
         a.free_rows == b.free_rows && !a.boundary && !b.boundary && !a.port && !b.port &&
         (a.F.size() == 0
              ? b.F.size() == 0
              : a.F.rows() == b.F.rows() && a.F.cols() == b.F.cols() && SparseMatrix(a.F - b.F).norm() == 0) &&
         same_matrix(a.M, b.M);
}

std::vector<std::vector<Index>> groups_of(const Batch& b) {
  std::vector<std::vector<Index>> groups;
  if (b.own.empty() && !own_matrices(b)) {
    groups.emplace_back();
    for (Index k = 0; k < b.scenes; ++k) groups[0].push_back(k);
    return groups;
  }
  if (b.own.empty()) {
    for (Index k = 0; k < b.scenes; ++k) groups.push_back({k});
    return groups;
  }
  std::map<std::pair<std::size_t, double>, std::vector<std::size_t>> known;  // groups with these dynamics and T
  for (Index k = 0; k < b.scenes; ++k) {
    const Scene& scene = b.own[std::size_t(k)];
    std::vector<std::size_t>& same = known[{hash_of(scene.dynamics), scene.T}];
    const auto found = std::find_if(same.begin(), same.end(), [&](std::size_t g) {
      return share_preparation(b.own[std::size_t(groups[g].front())], scene);
    });
    if (found != same.end()) {
      groups[*found].push_back(k);
    } else {
      same.push_back(groups.size());
      groups.push_back({k});
    }
  }
  return groups;
}

// One call: results of all scenes, filled group by group.
class BatchRun {
 public:
  BatchRun(const Batch& batch, Backend& backend, const Options& options)
      : batch_(batch), backend_(backend), options_(options), J_(steps_of(first_of(batch), options)) {
    options_.progress = {};
    options_.steps = J_;
    const Scene& first = first_of(batch);
    result_.scenes = batch.scenes;
    result_.t = time_grid(first.T > 0 ? first.T : 1, J_);
    const Index n = first.constraints(), rows = batch.scenes * (J_ + 1);
    result_.x_components = recorded_components(first, options);
    result_.y.resize(rows, n);
    result_.w.resize(options.trace ? rows : 0, n);
    result_.x.resize(rows, Index(result_.x_components.size()));
    const std::size_t K = std::size_t(batch.scenes);
    result_.status.assign(K, Status::interrupted);
    result_.reason.assign(K, "stopped on request before this scene");
    result_.warning.assign(K, "");
    result_.method.assign(K, options.method);
    result_.infeasible_at.assign(K, NAN);
    result_.residual = Vector::Constant(batch.scenes, NAN);
    done_.assign(K, 0);
  }

  BatchResult run(const std::function<void(const Progress&)>& progress) {
    Timer timer;
    progress_ = progress;
    for (const std::vector<Index>& group : groups_of(batch_)) {
      if (stopped_) break;
      if (Index(group.size()) >= fewest_in_lanes) take_lanes(group);
      take_singly(group);
    }
    for (Index k = 0; k < batch_.scenes; ++k)
      if (!done_[std::size_t(k)]) clear(k);
    result_.bytes = sizeof(double) * std::size_t(result_.y.size() + result_.w.size() + result_.x.size());
    result_.seconds = timer.lap();
    return std::move(result_);
  }

 private:
  Eigen::Block<RowMatrix> rows_of(RowMatrix& all, Index k) {
    return all.block(k * (J_ + 1), 0, all.size() > 0 ? J_ + 1 : 0, all.cols());
  }
  void clear(Index k) {
    for (RowMatrix* all : {&result_.y, &result_.w, &result_.x}) rows_of(*all, k).setConstant(NAN);
  }
  void say(Index more) {
    count_ += more;
    if (progress_) progress_({count_, 0, batch_.scenes});
    stopped_ = stopped_ || (options_.interrupted && options_.interrupted());
  }

  // ---- Side by side.

  bool for_lanes() const {
    return (options_.method == Method::automatic || options_.method == Method::march) && !controls_error(options_) &&
           !options_.event_location && !options_.goal && !options_.tuning.first_iterate && !options_.log && J_ >= 2 &&
           LaneMarch::bytes(first_of(batch_).states(), first_of(batch_).constraints(), J_) <= most_lane_bytes;
  }

  void take_lanes(const std::vector<Index>& group) {
    if (!for_lanes()) return;
    const bool own = own_sources(batch_);
    std::unique_ptr<LanePlan> plan;
    try {
      Scene scene = scene_of(batch_, group.front());
      if (!scene.x0.allFinite()) scene.x0 = Vector::Zero(scene.states());
      scene.validate();
      std::string why;
      plan = LanePlan::make(scene, backend_, J_, own, why);
    } catch (const Error&) {  // each scene says so
    }
    if (!plan) return;
    const Index together = lanes * groups_between_polls * std::max(1, backend_.threads());
    const Index count = Index(group.size());
    for (Index first = 0; first < count && !stopped_; first += together) {
      const Index settled = march_scenes(*plan, group, first, std::min(count, first + together), own);
      result_.in_lanes += settled;
      say(settled);
    }
  }

  // Scenes group[first .. last): functions of the user are called by this thread alone. Returns how many are settled.
  Index march_scenes(const LanePlan& plan, const std::vector<Index>& group, Index first, Index last, bool own) {
    std::vector<LaneInput> inputs;
    std::vector<Index> scenes;
    for (Index i = first; i < last; ++i) {
      LaneInput input;
      try {
        if (!input_of(plan, group[std::size_t(i)], own, input)) continue;
      } catch (const Error&) {  // the single solve says so
        continue;
      }
      inputs.push_back(std::move(input));
      scenes.push_back(group[std::size_t(i)]);
    }
    const Index count = Index(scenes.size()), ranges = (count + lanes - 1) / lanes;
    const Index shared = std::max<Index>(1, ranges / (4 * std::max(1, backend_.threads())));
    std::atomic<Index> settled = 0;
    share(backend_, ranges, shared, [&](Index begin, Index end) {
      LaneMarch march(plan);
      for (Index range = begin; range < end; ++range)
        settled += march_range(march, inputs, scenes, range * lanes, std::min(count, (range + 1) * lanes));
    });
    return settled;
  }

  // x0 and, where they are its own, the sources of a scene. False for what a single solve has to look at.
  bool input_of(const LanePlan& plan, Index k, bool own, LaneInput& input) const {
    if (!own) {
      input.x0 = batch_.own.empty() ? (batch_.x0.size() > 0 ? Vector(batch_.x0.row(k).transpose()) : batch_.common.x0)
                                    : batch_.own[std::size_t(k)].x0;
      return input.x0.size() == plan.m && input.x0.allFinite();
    }
    const Scene scene = scene_of(batch_, k);
    scene.validate_x0(scene.x0);
    scene.validate_sources();
    input.x0 = scene.x0;
    const SampledSource g = sample(scene.g, plan.t, plan.n),
                        f = scene.f ? sample(scene.f, plan.t, scene.sources()) : SampledSource();
    if (g.not_finite() >= 0 || (f.size() > 0 && f.not_finite() >= 0)) return false;
    if (!find_source_steps(scene, plan.t, f, g, false).rough.empty()) return false;
    input.g = g.table();
    input.drift = RowMatrix::Zero(plan.J + 1, plan.m);
    if (plan.euler) input.f = f.size() > 0 ? RowMatrix(f.table() * plan.F.transpose()) : input.drift;
    if (f.size() == 0) return true;
    input.drift = f.table() * plan.drive_right.transpose();
    input.drift.bottomRows(plan.J) += f.table().topRows(plan.J) * plan.drive_left.transpose();
    return true;
  }

  Index march_range(LaneMarch& march, const std::vector<LaneInput>& inputs, const std::vector<Index>& scenes,
                    Index begin, Index end) {
    std::vector<const LaneInput*> pointers;
    for (Index i = begin; i < end; ++i) pointers.push_back(&inputs[std::size_t(i)]);
    std::vector<LaneOutcome> outcomes;
    march.run(pointers, outcomes);
    Index settled = 0;
    for (std::size_t l = 0; l < outcomes.size(); ++l)
      if (outcomes[l].settled) {
        keep(march, Index(l), scenes[std::size_t(begin) + l], outcomes[l]);
        ++settled;
      }
    return settled;
  }

  void keep(const LaneMarch& march, Index lane, Index k, const LaneOutcome& outcome) {
    march.write_y(lane, rows_of(result_.y, k));
    if (result_.w.size() > 0) march.write_w(lane, rows_of(result_.w, k));
    if (result_.x.size() > 0) march.write_x(lane, result_.x_components, rows_of(result_.x, k));
    result_.status[std::size_t(k)] = Status::solved;
    result_.reason[std::size_t(k)].clear();
    result_.method[std::size_t(k)] = Method::march;
    result_.residual[k] = outcome.residual;
    if (outcome.other_at_zero)  // as core/solve/certification.cpp says it
      result_.warning[std::size_t(k)] = "y(0) is not unique: the problem at t = 0 has another solution";
    done_[std::size_t(k)] = 1;
  }

  // ---- One after the other.

  void take_singly(const std::vector<Index>& group) {
    solvers_.clear();
    for (const Index k : group) {
      if (stopped_) return;
      if (done_[std::size_t(k)]) continue;
      try {
        take(k, scene_of(batch_, k), group.size() > 1);
      } catch (const Error& error) {
        if (!of_one_scene(error)) throw;
        clear(k);
        result_.status[std::size_t(k)] = Status::unsupported;
        result_.reason[std::size_t(k)] = error.what();
        solvers_.clear();
      }
      done_[std::size_t(k)] = 1;
      say(1);
    }
  }

  // The Solver of the units that a single solve would choose: those of its first scene stay.
  struct UnitSolver {
    NaturalUnits units;
    std::unique_ptr<Solver> solver;
  };
  static bool same_units(const NaturalUnits& a, const NaturalUnits& b) {
    return a.x == b.x && a.y == b.y && a.w == b.w;
  }

  Result solved_by_solver(const Scene& scene) {
    scene.validate();
    NaturalUnits units = natural_units(scene);
    const auto found =
        std::find_if(solvers_.begin(), solvers_.end(), [&](const UnitSolver& s) { return same_units(s.units, units); });
    if (found == solvers_.end()) {
      if (solvers_.size() >= most_solvers) solvers_.erase(solvers_.begin());
      solvers_.push_back({std::move(units), std::make_unique<Solver>(scene, backend_, options_)});
      return solvers_.back().solver->solve();
    }
    found->solver->set_x0(scene.x0);
    if (own_sources(batch_)) found->solver->set_sources(scene.f, scene.g, scene.breakpoints, scene.breakpoints_are_all);
    ++result_.prepared;
    return found->solver->solve();
  }

  void take(Index k, const Scene& scene, bool shares) {
    const Result result =
        shares && !scene.boundary && !scene.port ? solved_by_solver(scene) : solve(scene, backend_, options_);
    rows_of(result_.y, k) = result.y;
    if (result_.w.size() > 0) {
      const RowMatrix w = slack(scene, result);
      if (w.rows() == J_ + 1)
        rows_of(result_.w, k) = w;
      else
        rows_of(result_.w, k).setConstant(NAN);
    }
    if (result_.x.size() > 0) rows_of(result_.x, k) = result.x;
    result_.status[std::size_t(k)] = result.status;
    result_.reason[std::size_t(k)] = result.reason;
    result_.warning[std::size_t(k)] = result.warning;
    result_.method[std::size_t(k)] = result.method;
    result_.residual[k] = result.residual;
    result_.infeasible_at[std::size_t(k)] = result.infeasible_at.value_or(NAN);
  }

  const Batch& batch_;
  Backend& backend_;
  Options options_;
  Index J_, count_ = 0;
  bool stopped_ = false;
  std::function<void(const Progress&)> progress_;
  std::vector<char> done_;
  static constexpr std::size_t most_solvers = 4;
  std::vector<UnitSolver> solvers_;  ///< of the group that is solved now
  BatchResult result_;
};

// Options that the lanes read; a single solve looks at the others.
void validate_options(const Batch& batch, const Options& options) {
  if (options.steps < 0 || options.steps > most_steps)
    throw Error("steps", "found " + std::to_string(options.steps), "give a whole number from 1 to 16777216");
  for (const Index c : options.components)
    if (c < 0 || c >= first_of(batch).states())
      throw Error("states", "component " + std::to_string(c) + " of " + std::to_string(first_of(batch).states()),
                  "components are counted from 0");
  if (controls_error(options))
    throw Error("tolerance", "is given to a batch", "give steps: the rows of all scenes are at the same times");
  if (options.method == Method::goal)
    throw Error("method", "found goal for a batch", "use another method: its grids differ from scene to scene");
}

Batch part_of(const Batch& b, Index first, Index count) {
  Batch part;
  part.common = b.common;
  part.scenes = count;
  const auto cut = [&](const auto& from, auto& to) {
    if (!from.empty()) to.assign(from.begin() + first, from.begin() + first + count);
  };
  cut(b.A, part.A), cut(b.B, part.B), cut(b.N, part.N), cut(b.M, part.M), cut(b.E, part.E);
  cut(b.f, part.f), cut(b.g, part.g), cut(b.breakpoints, part.breakpoints), cut(b.own, part.own);
  if (b.x0.size() > 0) part.x0 = b.x0.middleRows(first, count);
  return part;
}

}  // namespace

void Batch::validate() const {
  if (scenes < 1) throw Error("scenes", "is " + std::to_string(scenes), "give at least one scene");
  if (!own.empty()) {
    require_axis("own", own, scenes);
    for (std::size_t k = 0; k < own.size(); ++k)
      for (const auto& [name, found, expected] :
           {std::tuple("states", own[k].states(), own[0].states()),
            std::tuple("constraints", own[k].constraints(), own[0].constraints()),
            std::tuple("default_steps", own[k].default_steps, own[0].default_steps)})
        if (found != expected)
          throw Error(name, "is " + std::to_string(found) + " in scene " + std::to_string(k),
                      "give " + std::to_string(expected) + " as in scene 0: all have one structure");
    return;
  }
  const Index m = common.states(), n = common.constraints();
  Scene shared = common;
  if (x0.size() > 0) shared.x0 = Vector::Zero(m);
  if (!f.empty()) shared.f = {};
  if (!g.empty()) shared.g = {};
  if (!f.empty() || !g.empty() || !breakpoints.empty()) shared.breakpoints.clear();
  if (A.empty() && B.empty() && N.empty() && M.empty() && E.empty()) shared.validate();
  require_axis("A", A, scenes), require_axis("B", B, scenes), require_axis("N", N, scenes);
  require_axis("M", M, scenes), require_axis("E", E, scenes), require_axis("f", f, scenes);
  require_axis("g", g, scenes), require_axis("breakpoints", breakpoints, scenes);
  require_matrices("A", A, m, m), require_matrices("B", B, m, n), require_matrices("N", N, n, m);
  require_matrices("M", M, n, n), require_matrices("E", E, m, m);
  if (x0.size() > 0) require_shape("x0", x0, scenes, m, "scenes x states");
  if ((!A.empty() || !B.empty() || !N.empty() || !E.empty()) && !common.dynamics->small_state())
    throw Error("A", "is given for each scene of dynamics that are not dense", "give a list of whole scenes");
}

Batch batch_of(std::vector<Scene> scenes) {
  Batch batch;
  batch.scenes = Index(scenes.size());
  batch.own = std::move(scenes);
  return batch;
}

Scene scene_of(const Batch& b, Index k) {
  const std::size_t i = std::size_t(k);
  if (!b.own.empty()) return b.own[i];
  Scene scene = b.common;
  if (!b.A.empty() || !b.B.empty() || !b.N.empty() || !b.E.empty()) {
    DenseDynamics d = to_dense(b.common.dynamics);
    if (!b.A.empty()) d.A = b.A[i];
    if (!b.B.empty()) d.B = b.B[i];
    if (!b.N.empty()) d.N = b.N[i];
    if (!b.E.empty()) d.E = b.E[i];
    scene.dynamics = std::move(d);
  }
  if (!b.M.empty()) scene.M = b.M[i];
  if (b.x0.size() > 0) scene.x0 = b.x0.row(k).transpose();
  if (!b.f.empty()) scene.f = b.f[i];
  if (!b.g.empty()) scene.g = b.g[i];
  if (!b.breakpoints.empty()) scene.breakpoints = b.breakpoints[i];
  if (!b.f.empty() || !b.g.empty() || !b.breakpoints.empty()) {
    scene.breakpoints_are_all = b.breakpoints_are_all;
    scene.no_pulses = b.no_pulses;
  }
  scene.exact = {};
  return scene;
}

Index BatchResult::solved() const { return std::count(status.begin(), status.end(), Status::solved); }

double predicted_bytes(const Batch& b, const Options& options, Index scenes, int threads) {
  const Scene& scene = first_of(b);
  const double rows = double(steps_of(scene, options) + 1), n = double(scene.constraints());
  const double columns = n * (options.trace ? 2 : 1) + double(recorded_components(scene, options).size());
  const double of_lanes = LaneMarch::bytes(scene.states(), scene.constraints(), Index(rows) - 1);
  return sizeof(double) * rows * columns * double(scenes) + 200.0 * double(scenes) +
         (of_lanes <= most_lane_bytes ? of_lanes * double(threads) : 0);
}

BatchResult solve_batch(const Batch& batch, Backend& backend, const Options& options) {
  batch.validate();
  validate_options(batch, options);
  const double bytes = predicted_bytes(batch, options, batch.scenes, backend.threads());
  if (options.memory_limit > 0 && bytes > options.memory_limit)
    throw Error("memory_limit", text("%ld scenes are predicted to need %.3g bytes", long(batch.scenes), bytes),
                "raise it, record fewer states, or solve in blocks", ErrorKind::does_not_fit);
  return BatchRun(batch, backend, options).run(options.progress);
}

Index solve_in_blocks(const Batch& batch, Backend& backend, const Options& options,
                      const std::function<void(Index first, const BatchResult&)>& take) {
  batch.validate();
  validate_options(batch, options);
  const double limit = options.memory_limit > 0 ? options.memory_limit : default_block_bytes;
  const double fixed = predicted_bytes(batch, options, 0, backend.threads()),
               each = predicted_bytes(batch, options, 1, backend.threads()) - fixed;
  const Index most = std::max<Index>(1, Index(std::min((limit - fixed) / each, 1e15)));
  Index blocks = 0;
  for (Index first = 0; first < batch.scenes; first += most, ++blocks) {
    const Index count = std::min(most, batch.scenes - first);
    Options inner = options;
    if (options.progress)
      inner.progress = [&options, first, all = batch.scenes](const Progress& p) {
        options.progress({first + p.iteration, 0, all});
      };
    const BatchResult result = BatchRun(part_of(batch, first, count), backend, inner).run(inner.progress);
    take(first, result);
    if (options.interrupted && options.interrupted()) return blocks + 1;
  }
  return blocks;
}

}  // namespace bromwich
