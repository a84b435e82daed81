// Scenes of a batch on a backend that steps many of them at a time.

#include "batch/batch_groups.hpp"
#include "batch/batch_run.hpp"
#include "batch/device_march.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

constexpr Index fewest_on_device = 32;  ///< scenes of a group, a warp

}  // namespace

// On a backend that steps many scenes at a time. Returns those that it has not settled.
std::vector<Index> BatchRun::march_on_device(const LanePlan& plan, const std::vector<Index>& group) {
  const auto& scene_march = backend_.fused().scene_march;
  if (!scene_march || own_sources_ || !plan.parts.empty() || Index(group.size()) < fewest_on_device) return group;
  const double each = 32.0 * double(J_ + 1) * double(plan.m + plan.n);
  const Index together = std::clamp<Index>(Index(0.25 * backend_.device().memory / each), 1, Index(group.size()));
  const std::unique_ptr<SceneMarch> march = scene_march(scene_march_problem(plan), together);
  if (!march) return group;
  const Vector g0 = (plan.stages ? plan.sources.at_points : plan.sources.g).row(0).transpose();
  std::vector<Index> rest;
  RowMatrix x, y;
  for (Index first = 0; first < Index(group.size()) && !stopped_; first += together) {
    const DeviceStarts starts =
        starts_of(plan, &group[std::size_t(first)], std::min(together, Index(group.size()) - first), g0, rest);
    const std::vector<Index>& scenes = starts.scenes;
    const Index count = Index(scenes.size());
    if (count == 0) continue;
    const bool whole = count == batch_.scenes && scenes.front() == 0;  // in order, without a gap
    march->start(starts.x0, starts.y0, starts.other);
    touch_.reset();
    download_rows(*march, whole, y, x);
    const SceneMarchOutcome outcome = march->outcome();
    Index settled = 0;
    for (Index i = 0; i < count; ++i) {
      const Index k = scenes[std::size_t(i)];
      if (!outcome.settled[std::size_t(i)] || !starts.found[std::size_t(i)]) {
        rest.push_back(k);
        continue;
      }
      settle(k, outcome.residual[i], starts.other[std::size_t(i)] != 0);
      ++settled;
    }
    backend_.each_range(count, 64, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i)
        if (done_[std::size_t(scenes[std::size_t(i)])]) keep_rows(plan, scenes[std::size_t(i)], i, whole, y, x);
    });
    result_.in_lanes += settled;
    say(settled);
  }
  return rest;
}

// Where scenes begin, on all threads. Those that a single solve has to look at are added to `rest`.
BatchRun::DeviceStarts BatchRun::starts_of(const LanePlan& plan, const Index* group, Index count, const Vector& g0,
                                           std::vector<Index>& rest) const {
  RowMatrix x0(count, plan.m), y0(count, plan.n);
  std::vector<char> good(std::size_t(count), 0), found = good, other = good;
  backend_.each_range(count, 64, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) {
      LaneInput input;
      if (!input_of(plan, group[i], input)) continue;
      const LaneStart start = plan.start(input.x0, g0);
      x0.row(i) = input.x0.transpose();
      y0.row(i) = start.y.transpose();
      good[std::size_t(i)] = 1, found[std::size_t(i)] = start.found, other[std::size_t(i)] = start.other;
    }
  });
  DeviceStarts starts;
  for (Index i = 0; i < count; ++i) {
    if (!good[std::size_t(i)]) {
      rest.push_back(group[i]);
      continue;
    }
    const Index to = Index(starts.scenes.size());
    if (to < i) x0.row(to) = x0.row(i), y0.row(to) = y0.row(i);
    starts.scenes.push_back(group[i]);
    starts.found.push_back(found[std::size_t(i)]);
    starts.other.push_back(other[std::size_t(i)]);
  }
  const Index kept = Index(starts.scenes.size());
  x0.conservativeResize(kept, Eigen::NoChange), y0.conservativeResize(kept, Eigen::NoChange);
  starts.x0 = std::move(x0), starts.y0 = std::move(y0);
  return starts;
}

void BatchRun::download_rows(SceneMarch& march, bool whole, RowMatrix& y, RowMatrix& x) {
  RowMatrix& to = whole ? result_.y : y;
  if (!whole && to.size() == 0) {
    to.resize(march.y().rows(), march.y().cols());
    const FirstTouch before_the_copy(to.data(), std::size_t(to.size()));
  }
  backend_.download(march.y(), to);
  if (result_.x.size() > 0 || result_.w.size() > 0) backend_.download(march.x(), x);
}

// Scene k from row i (J+1) of the tables of a device.
void BatchRun::keep_rows(const LanePlan& plan, Index k, Index i, bool whole, const RowMatrix& y, const RowMatrix& x) {
  const auto own_y = (whole ? result_.y : y).middleRows(i * rows_, rows_);
  if (!whole) rows_of(result_.y, k) = own_y;
  if (result_.w.size() == 0 && result_.x.size() == 0) return;
  const auto own_x = x.middleRows(i * rows_, rows_);
  if (result_.x.size() > 0) rows_of(result_.x, k) = own_x(Eigen::all, result_.x_components);
  if (result_.w.size() == 0) return;
  const Scene& scene = batch_.own.empty() ? batch_.common : batch_.own[std::size_t(k)];
  RowMatrix g = plan.stages ? plan.sources.at_points : plan.sources.g;
  for (Index c = 0; c < plan.n && !plan.units.trivial(); ++c)
    for (Index j = 0; j < rows_; ++j) g(j, c) = times_ten_to(plan.units.w[std::size_t(c)], g(j, c));
  rows_of(result_.w, k) =
      g + own_x * scene.dynamics->small_state()->N.transpose() + own_y * to_dense(scene.M).transpose();
}

}  // namespace bromwich
