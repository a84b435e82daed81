// Scenes of a batch with matrices of their own, eight at a time in lanes.

#include "batch/batch_groups.hpp"
#include "batch/batch_run.hpp"
#include "core/base/error.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

constexpr Index most_plans = Index(1) << 14;  ///< held for a device

// Lanes of one kind can be stepped together.
using Kind = std::tuple<bool, bool, bool, bool, double, double>;
Kind kind_of(const LanePlan& p) { return {p.stages, p.surely_P, p.certain, p.euler.has_value(), p.most_growth, p.h}; }

// Decisions with stages are those of a single solve, made in the natural units of the scene.
std::unique_ptr<LanePlan> plan_of(const Scene& scene, const NaturalUnits& nearby, Backend& backend, Index J) {
  std::string why;
  auto plan = LanePlan::make(scene, backend, J, true, &nearby, why);
  if (!plan || !plan->stages) return plan;
  const NaturalUnits units = natural_units(scene);
  return same_units(units, plan->units) ? std::move(plan) : LanePlan::make(scene, backend, J, true, &units, why);
}

}  // namespace

// What plans of scenes have in common. None if no scene is valid, or if shared sources are not smooth.
struct BatchRun::OwnPlans {
  NaturalUnits nearby;
  std::optional<SourceSamples> samples;  ///< of f and g, where scenes share them
  Scene sized;                           ///< a scene with the largest values of f and g as constants
};

std::optional<BatchRun::OwnPlans> BatchRun::common_of_plans(const std::vector<Index>& all) const {
  for (const Index k : all) try {
      const Scene scene = scene_of(batch_, k);
      scene.validate();
      OwnPlans common{natural_units(scene), {}, {}};
      if (own_sources_) return common;
      common.samples = SourceSamples::of(scene, backend_, J_);
      if (!common.samples) return std::nullopt;
      common.sized = with_constant_sources(batch_.own.empty() ? batch_.common : scene);
      return common;
    } catch (const Error&) {  // the single solve says so
    }
  return std::nullopt;
}

// The scene is left without a plan where a single solve has to look at it. `scene` is overwritten, but for f and g.
void BatchRun::plan_with_samples(const OwnPlans& common, Index k, Scene& scene, Planned& to) const {
  if (batch_.own.empty()) {
    put_own_data(batch_, k, scene);
  } else {
    scene = batch_.own[std::size_t(k)];
    scene.f = common.sized.f, scene.g = common.sized.g;
  }
  scene.validate();
  to.plan = plan_of(scene, common.nearby, backend_, J_);
  if (to.plan) to.input = {to.plan.get(), to.plan->start_of(scene.x0), {}, &*common.samples};
}

// Calls functions of the user.
void BatchRun::plan_with_own_sources(const OwnPlans& common, Index k, Planned& to) const {
  const Scene scene = scene_of(batch_, k);
  scene.validate();
  to.plan = plan_of(scene, common.nearby, backend_, J_);
  if (!to.plan) return;
  if (auto sources = to.plan->sources_of(scene))
    to.input = {to.plan.get(), to.plan->start_of(scene.x0), std::make_shared<const LaneSources>(std::move(*sources))};
}

// Scenes that share neither dynamics nor M: a plan each.
void BatchRun::take_own(const std::vector<Index>& all) {
  const auto common = common_of_plans(all);
  if (!common) return;
  const bool on_device = bool(backend_.fused().scene_march);
  const std::size_t together = std::size_t(on_device ? most_plans : scenes_between_polls());
  for (std::size_t first = 0; first < all.size() && !stopped_; first += together) {
    std::vector<Planned> planned(std::min(together, all.size() - first));
    const Index count = Index(planned.size());
    const auto plan = [&](Index begin, Index end) {
      Scene scene = common->sized;
      for (Index i = begin; i < end; ++i) try {
          const Index k = all[first + std::size_t(i)];
          Planned& to = planned[std::size_t(i)];
          common->samples ? plan_with_samples(*common, k, scene, to) : plan_with_own_sources(*common, k, to);
        } catch (const Error&) {  // the single solve says so
        }
    };
    if (common->samples)
      share(backend_, count, 16, plan);
    else
      for (Index i = 0; i < count && !(i % 16 == 0 && asked_to_stop()); ++i) plan(i, i + 1);
    std::map<Kind, std::vector<Prepared>> kinds;
    for (Index i = 0; i < count; ++i)
      if (const Planned& p = planned[std::size_t(i)]; p.input.plan)
        kinds[kind_of(*p.plan)].push_back({all[first + std::size_t(i)], p.input});
    Index settled = 0;
    for (auto& [kind, same] : kinds) {
      const std::vector<Prepared> left = on_device ? march_own_on_device(std::move(same)) : std::move(same);
      settled += march(left);
    }
    share(backend_, count, 16, [&](Index begin, Index end) {  // freeing takes a while too
      for (Index i = begin; i < end; ++i) planned[std::size_t(i)] = {};
    });
    say(settled);
  }
}

}  // namespace bromwich
