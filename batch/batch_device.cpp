// Scenes of a batch on a backend that steps many of them at a time.

#include "batch/batch_groups.hpp"
#include "batch/batch_run.hpp"
#include "batch/device_march.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

constexpr Index fewest_on_device = 32;  ///< scenes of a group, a warp
constexpr double share_of_memory = 0.25;

// Of results, of plans and of the maps of active sets.
double bytes_of_scene(const SceneMarchProblem& p) {
  const scene_steps::PlanLayout& l = p.layout;
  const double rows = 4.0 * double(p.J + 1) * double(l.m + l.n);
  if (p.plan.size() > 0) return sizeof(double) * rows;
  const double maps = double(l.sets() * l.unknowns() * l.unknowns() + (l.stages ? (l.n * l.n) << l.n : 0));
  return sizeof(double) * (rows + 2 * double(l.at(scene_steps::PlanTable::count)) + maps);
}

// Whether active sets have lasted longer than the steps resolve (LanePlan::longest). Scenes that share a plan share
// what is known of its sets.
class RunLimits {
 public:
  explicit RunLimits(Index n) : known_(std::size_t(1) << n, NAN) {}
  bool exceeded(const LanePlan& plan, const int* runs) {
    if (plan_ != &plan) known_.assign(known_.size(), NAN);
    plan_ = &plan;
    for (std::size_t set = 0; set < known_.size(); ++set) {
      if (runs[set] == 0) continue;
      if (std::isnan(known_[set])) known_[set] = plan.longest(unsigned(set));
      if (double(runs[set]) > known_[set]) return true;
    }
    return false;
  }

 private:
  const LanePlan* plan_ = nullptr;
  std::vector<double> known_;
};

}  // namespace

bool BatchRun::marches_on_device(const LanePlan& plan, Index scenes) const {
  return backend_.fused().scene_march && plan.parts.empty() && scenes >= fewest_on_device;
}

// Scenes that share a plan. Returns those that it has not settled.
std::vector<Index> BatchRun::march_on_device(const LanePlan& plan, const std::vector<Index>& group) {
  if (own_sources_ || !marches_on_device(plan, Index(group.size()))) return group;
  std::vector<Prepared> scenes(group.size());
  std::vector<char> good(group.size(), 0);
  backend_.each_range(Index(group.size()), 64, [&](Index begin, Index end) {
    for (std::size_t i = std::size_t(begin); i < std::size_t(end); ++i) {
      scenes[i].scene = group[i];
      good[i] = input_of(plan, group[i], scenes[i].input);
    }
  });
  std::vector<Index> rest;
  std::vector<Prepared> taken;
  for (std::size_t i = 0; i < scenes.size(); ++i)
    good[i] ? taken.push_back(std::move(scenes[i])) : rest.push_back(group[i]);
  for (const Prepared& left : march_on_device(shared_march_problem(plan), std::move(taken))) rest.push_back(left.scene);
  return rest;
}

// The same of scenes with plans of their own, of one kind.
std::vector<BatchRun::Prepared> BatchRun::march_own_on_device(std::vector<Prepared> scenes) {
  const LaneInput& first = scenes.front().input;
  if (!first.samples || first.plan->euler || !marches_on_device(*first.plan, Index(scenes.size()))) return scenes;
  SceneMarchProblem problem = own_march_problem(*first.plan, *first.samples);
  for (const Prepared& scene : scenes) problem.rigid |= scene.input.plan->rigid;
  return march_on_device(std::move(problem), std::move(scenes));
}

std::vector<BatchRun::Prepared> BatchRun::march_on_device(SceneMarchProblem problem, std::vector<Prepared> all) {
  problem.rows = grid_rows_;
  const Index most = Index(share_of_memory * backend_.device().memory / bytes_of_scene(problem));
  const Index together = std::clamp<Index>(most, 1, std::max<Index>(1, Index(all.size())));
  const std::unique_ptr<SceneMarch> march = all.empty() ? nullptr : backend_.fused().scene_march(problem, together);
  if (!march) return all;
  std::vector<Prepared> rest;
  RowMatrix x, y;
  for (Index first = 0; first < Index(all.size()) && !stopped_; first += together) {
    const Prepared* const scenes = &all[std::size_t(first)];
    const Index count = std::min(together, Index(all.size()) - first);
    const bool whole = count == batch_.scenes && scenes[0].scene == 0;  // in order, without a gap
    const DeviceStarts starts = starts_of(problem, scenes, count);
    march->start(starts.x0, starts.y0, starts.other, starts.plans);
    touch_.clear();
    if (!arrays_) download_rows(*march, whole, y, x);
    const SceneMarchOutcome outcome = march->outcome();
    const Index sets = Index(1) << problem.layout.n;
    std::vector<char> settled(std::size_t(count), 0);
    backend_.each_range(count, 64, [&](Index begin, Index end) {
      RunLimits limits(problem.layout.n);
      for (Index i = begin; i < end; ++i) {
        const Prepared& scene = scenes[i];
        settled[std::size_t(i)] = outcome.settled[std::size_t(i)] && starts.found[std::size_t(i)] &&
                                  !limits.exceeded(*scene.input.plan, &outcome.runs[std::size_t(i * sets)]);
        if (settled[std::size_t(i)] && !arrays_) keep_rows(scene.input, scene.scene, i, whole, y, x);
      }
    });
    if (arrays_) keep_in_arrays(*march, scenes, settled);
    Index more = 0;
    for (Index i = 0; i < count; ++i) {
      const auto at = std::size_t(i);
      if (!settled[at]) {
        rest.push_back(scenes[i]);
        continue;
      }
      settle(scenes[i].scene, outcome.residual[i], starts.other[at] != 0);
      ++more;
    }
    result_.in_lanes += more;
    say(more);
  }
  return rest;
}

// Where scenes begin, and their plans where each has its own, on all threads.
BatchRun::DeviceStarts BatchRun::starts_of(const SceneMarchProblem& p, const Prepared* scenes, Index count) const {
  const bool own = p.plan.size() == 0;
  const std::size_t K = std::size_t(count);
  DeviceStarts starts{RowMatrix(count, p.layout.m), RowMatrix(count, p.layout.n),
                      RowMatrix(own ? count : 0, own ? p.layout.at(scene_steps::PlanTable::count) : 0),
                      std::vector<char>(K), std::vector<char>(K)};
  ask_for_large_pages(starts.plans.data(), std::size_t(starts.plans.size()));
  backend_.each_range(count, 64, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) {
      const LaneInput& input = scenes[i].input;
      const LaneStart start = input.plan->start(input.x0, input.g_at(0));
      starts.x0.row(i) = input.x0.transpose();
      starts.y0.row(i) = start.y.transpose();
      if (own) write_plan(*input.plan, p.layout, starts.plans.row(i).data());
      starts.found[std::size_t(i)] = start.found, starts.other[std::size_t(i)] = start.other;
    }
  });
  return starts;
}

// To the result itself where it is the whole one and has all states.
void BatchRun::download_rows(SceneMarch& march, bool whole, RowMatrix& y, RowMatrix& x) {
  const auto fetch = [&](const Array& from, RowMatrix& result, RowMatrix& rows) {
    RowMatrix& to = whole && (&result == &result_.y || has_all_states(first_of(batch_))) ? result : rows;
    if (&to == &rows && to.size() == 0) {
      to.resize(from.rows(), from.cols());
      const FirstTouch before_the_copy(to.data(), std::size_t(to.size()));
    }
    backend_.download(from, to);
  };
  fetch(march.y(), result_.y, y);
  if (result_.x.size() > 0 || (result_.w.size() > 0 && !w_comes_later_)) fetch(march.x(), result_.x, x);
}

// Runs of neighbours at once.
void BatchRun::keep_in_arrays(SceneMarch& march, const Prepared* scenes, const std::vector<char>& settled) {
  const Array* const x = result_.x.cols() > 0 ? &march.x() : nullptr;
  const Index count = Index(settled.size());
  for (Index i = 0, end = 0; i < count; i = std::max(end, i + 1)) {
    for (end = i; end < count && settled[std::size_t(end)] && scenes[end].scene == scenes[i].scene + end - i;) ++end;
    if (end > i) arrays_->take(march.y(), x, i, scenes[i].scene, end - i);
  }
}

// Scene k from row i (J+1) of the tables of a device.
void BatchRun::keep_rows(const LaneInput& input, Index k, Index i, bool whole, const RowMatrix& y, const RowMatrix& x) {
  const auto own_y = (whole ? result_.y : y).middleRows(i * rows_, rows_);
  if (!whole) rows_of(result_.y, k) = own_y;
  if (result_.w.size() == 0 && result_.x.size() == 0) return;
  const bool x_is_there = whole && has_all_states(first_of(batch_));
  const auto own_x = (x_is_there ? result_.x : x).middleRows(i * rows_, rows_);
  if (result_.x.size() > 0 && !x_is_there) rows_of(result_.x, k) = own_x(Eigen::all, result_.x_components);
  if (w_comes_later_) result_.w_is_due[std::size_t(k)] = 1;
  if (result_.w.size() == 0 || w_comes_later_) return;
  const Scene scene = scene_of(batch_, k);
  auto w = rows_of(result_.w, k);
  w = own_x * scene.dynamics->small_state()->N.transpose() + own_y * to_dense(scene.M).transpose();
  const std::vector<int>& units = input.plan->units.w;
  for (Index j = 0; j < rows_; ++j) {
    const Vector g = input.g_at(grid_rows_[std::size_t(j)]);
    for (Index c = 0; c < g.size(); ++c) w(j, c) += units.empty() ? g[c] : times_ten_to(units[std::size_t(c)], g[c]);
  }
}

}  // namespace bromwich
