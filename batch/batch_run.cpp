#include "batch/batch_run.hpp"

#include "batch/batch_groups.hpp"
#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/result/notice.hpp"
#include "core/scene/natural_sizes.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/cost.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <map>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

constexpr Index fewest_in_lanes = 2;  ///< scenes of a group

/// Bytes that the scenes of all threads may hold together, where the caller gives no limit.
constexpr double most_side_by_side_bytes = 4e9;

using UnitKey = std::tuple<std::vector<int>, std::vector<int>, std::vector<int>>;
UnitKey key_of(const NaturalUnits& units) { return {units.x, units.y, units.w}; }

}  // namespace

namespace {

// The time points of the grid that the rows are for; empty where the times of a batch are others.
std::vector<Index> grid_rows(const Batch& batch, double T, Index J) {
  std::vector<Index> rows(batch.times.empty() ? std::size_t(J) + 1 : batch.times.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double at = batch.times.empty() ? double(i) : batch.times[i] / T * double(J);
    rows[i] = std::lround(at);
    if (!(std::abs(at - double(rows[i])) <= 8 * epsilon * double(J))) return {};
  }
  return rows;
}

}  // namespace

BatchRun::BatchRun(const Batch& batch, Backend& backend, const Options& options, const MakeBackend& another)
    : batch_(batch),
      backend_(backend),
      options_(options),
      J_(steps_of(first_of(batch), options)),
      own_sources_(own_sources(batch)),
      alone_(batch, backend, options_, result_),
      another_(another) {
  options_.progress = {};
  if (!controls_error(options_)) options_.steps = J_;
  const Scene& first = first_of(batch);
  result_.scenes = batch.scenes;
  result_.t = time_grid(first.T > 0 ? first.T : 1, J_);
  if (!batch.times.empty()) result_.t = Eigen::Map<const Vector>(batch.times.data(), Index(batch.times.size()));
  rows_ = result_.t.size();
  grid_rows_ = grid_rows(batch, first.T, J_);
  const Index n = first.constraints(), rows = batch.scenes * rows_;
  result_.x_components = recorded_components(first, options);
  result_.y.resize(rows, n);
  result_.w.resize(options.trace ? rows : 0, n);
  result_.x.resize(rows, Index(result_.x_components.size()));
  for (RowMatrix* fresh : {&result_.y, &result_.w, &result_.x})
    ask_for_large_pages(fresh->data(), std::size_t(fresh->size()));
  if (batch.keep_on_backend && backend.fused().slabs) keep_on_backend(first);
  for (RowMatrix* fresh : {&result_.y, &result_.x})
    if (backend.fused().scene_march && !arrays_) touch_.emplace_back(fresh->data(), std::size_t(fresh->size()));
  const std::size_t K = std::size_t(batch.scenes);
  result_.status.assign(K, Status::interrupted);
  result_.reason.assign(K, "");
  result_.warning.assign(K, "");
  result_.method.assign(K, options.method);
  result_.infeasible_at.assign(K, NAN);
  result_.residual = Vector::Constant(batch.scenes, NAN);
  done_.assign(K, 0);
}

bool BatchRun::has_all_states(const Scene& scene) const {
  const std::vector<Index>& recorded = result_.x_components;
  for (std::size_t i = 0; i < recorded.size(); ++i)
    if (recorded[i] != Index(i)) return false;
  return Index(recorded.size()) == scene.states();
}

void BatchRun::keep_on_backend(const Scene& first) {
  const Index states = result_.x.cols();
  if (states != 0 && !has_all_states(first))
    throw Error("states", text("has %ld of %ld states", long(states), long(first.states())),
                "record all of them, in order, or none where results stay on the device");
  result_.w.resize(0, 0);
  arrays_ = std::make_shared<BatchArrays>(backend_, batch_.scenes, rows_, result_.y.cols(), states);
}

BatchResult BatchRun::run(const std::function<void(const Progress&)>& progress, bool fill) {
  Timer timer;
  progress_ = progress;
  fill = fill || arrays_;
  w_comes_later_ = !fill && result_.w.size() > 0 && has_all_states(first_of(batch_));
  if (w_comes_later_) result_.w_is_due.assign(std::size_t(batch_.scenes), 0);
  std::vector<Index> alone;
  for (const std::vector<Index>& group : groups_of(batch_)) {
    if (stopped_) break;
    if (Index(group.size()) < fewest_in_lanes) {
      alone.push_back(group[0]);
      continue;
    }
    if (for_lanes()) take_lanes(group);
    take_singly(group, true);
  }
  if (for_lanes() && Index(alone.size()) >= fewest_in_lanes) take_own(alone);
  take_singly(alone, false);
  Index kept = batch_.scenes;
  while (!fill && kept > 1 && !done_[std::size_t(kept - 1)]) --kept;
  for (Index k = 0; k < batch_.scenes; ++k)
    if (!done_[std::size_t(k)]) {
      if (k < kept) clear_rows(result_, k);
      result_.reason[std::size_t(k)] = "stopped on request before this scene";
    }
  for (RowMatrix* all : {&result_.y, &result_.w, &result_.x})
    if (kept < batch_.scenes && all->rows() > 0) all->conservativeResize(kept * rows_, Eigen::NoChange);
  if (arrays_) {
    arrays_->take_others(result_.y, result_.x);
    for (RowMatrix* all : {&result_.y, &result_.x}) all->resize(0, 0);
    result_.arrays = arrays_;
  }
  result_.prepared = alone_.prepared() + (side_by_side_ ? side_by_side_->prepared() : 0);
  result_.bytes = sizeof(double) * std::size_t(result_.y.size() + result_.w.size() + result_.x.size());
  result_.seconds = timer.lap();
  return std::move(result_);
}

void BatchRun::say(Index more) {
  count_ += more;
  if (progress_) progress_({count_, 0, batch_.scenes});
  asked_to_stop();
}

bool BatchRun::asked_to_stop() {
  stopped_ = stopped_ || (options_.interrupted && options_.interrupted());
  return stopped_;
}

Index BatchRun::scenes_between_polls() const {
  const Index groups = std::clamp<Index>(steps_between_polls / (lanes * J_), 1, groups_between_polls);
  return lanes * groups * std::max(1, backend_.threads());
}

// ---- Side by side.

bool BatchRun::for_lanes() const {
  return (options_.method == Method::automatic || options_.method == Method::march) && !controls_error(options_) &&
         !options_.event_location && !options_.goal && !grid_rows_.empty() && !options_.tuning.first_iterate &&
         !options_.log && J_ >= 2 &&
         LaneMarch::bytes(first_of(batch_).states(), first_of(batch_).constraints(), J_) <= most_lane_bytes;
}

// Scenes that share dynamics and M. A single solve with stages decides in the natural units of its scene.
void BatchRun::take_lanes(const std::vector<Index>& group) {
  std::unique_ptr<LanePlan> plan;
  std::string why;
  const auto make = [&](Index k, const NaturalUnits* units) {
    Scene scene = scene_of(batch_, k);
    if (!scene.x0.allFinite()) scene.x0 = Vector::Zero(scene.states());
    scene.validate();
    plan = LanePlan::make(scene, backend_, J_, own_sources_, units, why);
  };
  try {
    make(group.front(), nullptr);
    if (!plan) return;
    if (!plan->stages) return march_group(*plan, group);
    const std::vector<NaturalUnits> units = units_of(group);
    if (stopped_) return;
    std::map<UnitKey, std::pair<NaturalUnits, std::vector<Index>>> by_units;
    for (std::size_t i = 0; i < group.size(); ++i) {
      auto& same = by_units[key_of(units[i])];
      same.first = units[i];
      same.second.push_back(group[i]);
    }
    for (const auto& [key, same] : by_units) {
      if (!plan || !same_units(plan->units, same.first)) make(same.second.front(), &same.first);
      if (plan && plan->stages) march_group(*plan, same.second);
    }
  } catch (const Error&) {  // each scene says so
  }
}

// The natural units of each scene of a group. They depend on f and g by their largest values: shared ones are sampled
// once.
std::vector<NaturalUnits> BatchRun::units_of(const std::vector<Index>& group) {
  std::vector<NaturalUnits> units(group.size());
  const auto of = [&](const Scene& scene) {
    const bool good = scene.x0.size() == scene.states() && scene.x0.allFinite();  // a single solve refuses others
    return good ? natural_units(scene) : NaturalUnits{};
  };
  if (own_sources_) {
    for (std::size_t i = 0; i < group.size() && !(i % 16 == 0 && asked_to_stop()); ++i)
      units[i] = of(scene_of(batch_, group[i]));
    return units;
  }
  const Scene common = with_constant_sources(scene_of(batch_, group.front()));
  share(backend_, Index(group.size()), 64, [&](Index begin, Index end) {
    Scene scene = common;
    for (Index i = begin; i < end; ++i) {
      const Index k = group[std::size_t(i)];
      scene.x0 = batch_.own.empty() ? (batch_.x0.size() > 0 ? Vector(batch_.x0.row(k).transpose()) : batch_.common.x0)
                                    : batch_.own[std::size_t(k)].x0;
      units[std::size_t(i)] = of(scene);
    }
  });
  return units;
}

void BatchRun::march_group(const LanePlan& plan, const std::vector<Index>& all) {
  const std::vector<Index> group = march_on_device(plan, all);
  const Index together = scenes_between_polls(), count = Index(group.size());
  for (Index first = 0; first < count && !stopped_; first += together) {
    std::vector<Prepared> scenes;  // functions of the user are called by this thread alone
    for (Index i = first; i < std::min(count, first + together) && !(own_sources_ && i % 16 == 0 && asked_to_stop());
         ++i)
      try {
        LaneInput input;
        if (input_of(plan, group[std::size_t(i)], input)) scenes.push_back({group[std::size_t(i)], std::move(input)});
      } catch (const Error&) {  // the single solve says so
      }
    say(march(scenes));
  }
}

// x0 and, where they are its own, the sources of a scene. False for what a single solve has to look at.
bool BatchRun::input_of(const LanePlan& plan, Index k, LaneInput& input) const {
  input.plan = &plan;
  if (!own_sources_) {
    input.x0 = plan.start_of(batch_.own.empty()
                                 ? (batch_.x0.size() > 0 ? Vector(batch_.x0.row(k).transpose()) : batch_.common.x0)
                                 : batch_.own[std::size_t(k)].x0);
    return input.x0.size() == plan.m && input.x0.allFinite();
  }
  const Scene scene = scene_of(batch_, k);
  scene.validate_x0(scene.x0);
  scene.validate_sources();
  input.x0 = plan.start_of(scene.x0);
  auto sources = plan.sources_of(scene);
  if (!sources) return false;
  input.sources = std::make_shared<const LaneSources>(std::move(*sources));
  return true;
}

// Returns how many are settled.
Index BatchRun::march(const std::vector<Prepared>& scenes) {
  const Index count = Index(scenes.size()), ranges = (count + lanes - 1) / lanes;
  if (count == 0) return 0;
  touch_.clear();
  const Index shared = std::max<Index>(1, ranges / (4 * std::max(1, backend_.threads())));
  std::atomic<Index> settled = 0;
  share(backend_, ranges, shared, [&](Index begin, Index end) {
    LaneMarch march(*scenes[0].input.plan);
    for (Index range = begin; range < end; ++range)
      settled += march_range(march, &scenes[std::size_t(range * lanes)], std::min(lanes, count - range * lanes));
  });
  result_.in_lanes += settled;
  return settled;
}

Index BatchRun::march_range(LaneMarch& march, const Prepared* first, Index count) {
  std::vector<const LaneInput*> inputs;
  for (Index i = 0; i < count; ++i) inputs.push_back(&first[i].input);
  std::vector<LaneOutcome> outcomes;
  march.run(inputs, outcomes);
  Index settled = 0;
  for (Index l = 0; l < count; ++l)
    if (outcomes[std::size_t(l)].settled) {
      keep(march, l, first[l].scene, outcomes[std::size_t(l)]);
      ++settled;
    }
  return settled;
}

void BatchRun::keep(const LaneMarch& march, Index lane, Index k, const LaneOutcome& outcome) {
  march.write_y(lane, grid_rows_, rows_of(result_.y, k));
  if (w_comes_later_)
    result_.w_is_due[std::size_t(k)] = 1;
  else if (result_.w.size() > 0)
    march.write_w(lane, grid_rows_, rows_of(result_.w, k));
  if (result_.x.size() > 0) march.write_x(lane, grid_rows_, result_.x_components, rows_of(result_.x, k));
  settle(k, outcome.residual, outcome.other_at_zero);
}

void BatchRun::settle(Index k, double residual, bool other_at_zero) {
  result_.status[std::size_t(k)] = Status::solved;
  result_.reason[std::size_t(k)].clear();
  result_.method[std::size_t(k)] = Method::march;
  result_.residual[k] = residual;
  if (other_at_zero)  // as core/solve/certification.cpp says it
    result_.warning[std::size_t(k)] = sentence({NoticeCode::other_start});
  done_[std::size_t(k)] = 1;
}

// ---- By single solves.

// Whether as many of these as there are threads fit into the memory.
bool BatchRun::may_be_side_by_side(const Scene& scene) const {
  if (!another_ || backend_.threads() < 2) return false;
  const double limit = options_.memory_limit > 0 ? options_.memory_limit : most_side_by_side_bytes;
  const Cost cost = predicted_cost(scene, options_.method, J_, Index(result_.x_components.size()), 1);
  return cost.bytes * backend_.threads() <= limit;
}

void BatchRun::take_singly(const std::vector<Index>& scenes, bool shares) {
  touch_.clear();
  std::vector<Index> left;
  const auto to_do = [&] {
    left.clear();
    std::copy_if(scenes.begin(), scenes.end(), std::back_inserter(left),
                 [&](Index k) { return !done_[std::size_t(k)]; });
  };
  to_do();
  if (!stopped_ && left.size() > 1 && may_be_side_by_side(first_of(batch_))) {
    if (!side_by_side_) side_by_side_.emplace(batch_, options_, result_, another_, backend_.threads());
    std::atomic<Index> done = 0;
    side_by_side_->take(
        left, shares,
        [&](Index k) {
          done_[std::size_t(k)] = 1;
          ++done;
        },
        [&] { say(done.exchange(0)); });
    to_do();  // what did not fit beside others
  }
  alone_.forget();
  for (const Index k : left) {
    if (stopped_) return;
    alone_.take(k, shares && scenes.size() > 1);
    done_[std::size_t(k)] = 1;
    say(1);
  }
}

}  // namespace bromwich
