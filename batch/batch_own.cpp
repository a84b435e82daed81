// Scenes of a batch with matrices of their own, eight at a time in lanes.

#include "batch/batch_groups.hpp"
#include "batch/batch_run.hpp"
#include "core/base/error.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

constexpr Index most_plans = Index(1) << 14;  ///< held for a device

// Lanes of one kind can be stepped together.
using Kind = std::tuple<bool, bool, bool, bool, double, double>;
Kind kind_of(const LanePlan& p) { return {p.stages, p.surely_P, p.certain, p.euler.has_value(), p.most_growth, p.h}; }

// A scene and its plan; none where a single solve has to look at it.
struct OwnScene {
  Index number;
  Scene scene;
  std::unique_ptr<LanePlan> plan;
  std::shared_ptr<const LaneSources> sources;
};

// Decisions with stages are those of a single solve, made in the natural units of the scene. `sized`: the scene, or
// with other sources of the same sizes.
void plan_in_own_units(OwnScene& own, const Scene& sized, Backend& backend, Index J) {
  if (!own.plan || !own.plan->stages) return;
  const NaturalUnits units = natural_units(sized);
  std::string why;
  if (!same_units(units, own.plan->units)) own.plan = LanePlan::make(own.scene, backend, J, true, &units, why);
}

}  // namespace

// Scenes that share neither dynamics nor M: a plan each.
void BatchRun::take_own(const std::vector<Index>& all) {
  const bool on_device = bool(backend_.fused().scene_march);
  const Index together = on_device ? most_plans : scenes_between_polls();
  std::optional<NaturalUnits> nearby;
  std::optional<SourceSamples> samples;  // where the scenes share f and g
  Scene sizes;                           // has the largest values of f and g as constants
  for (std::size_t first = 0; first < all.size() && !stopped_; first += std::size_t(together)) {
    std::vector<OwnScene> scenes;
    for (std::size_t i = first; i < std::min(all.size(), first + std::size_t(together)); ++i) try {
        Scene scene = scene_of(batch_, all[i]);
        scene.validate();
        scenes.push_back({all[i], std::move(scene), nullptr, nullptr});
      } catch (const Error&) {  // the single solve says so
      }
    if (!nearby && !scenes.empty()) {
      const Scene& sample = scenes.front().scene;
      nearby = natural_units(sample);
      if (!own_sources_) {
        samples = SourceSamples::of(sample, backend_, J_);
        if (!samples) return;
        sizes = with_constant_sources(sample);
      }
    }
    const Index count = Index(scenes.size());
    share(backend_, count, 8, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) try {
          OwnScene& own = scenes[std::size_t(i)];
          std::string why;
          own.plan = LanePlan::make(own.scene, backend_, J_, true, &*nearby, why);
          if (!samples) continue;
          Scene sized = own.scene;
          sized.f = sizes.f, sized.g = sizes.g;
          plan_in_own_units(own, sized, backend_, J_);
        } catch (const Error&) {  // the single solve says so
        }
    });
    std::map<Kind, std::vector<Prepared>> kinds;
    for (OwnScene& own : scenes) try {
        if (!samples) {  // functions of the user
          plan_in_own_units(own, own.scene, backend_, J_);
          if (auto sources = own.plan ? own.plan->sources_of(own.scene) : std::nullopt)
            own.sources = std::make_shared<const LaneSources>(std::move(*sources));
        }
        if (own.plan && (samples || own.sources))
          kinds[kind_of(*own.plan)].push_back(
              {own.number,
               {own.plan.get(), own.plan->start_of(own.scene.x0), own.sources, samples ? &*samples : nullptr}});
      } catch (const Error&) {  // the single solve says so
      }
    Index settled = 0;
    for (const auto& [kind, same] : kinds) settled += march(on_device ? march_own_on_device(same) : same);
    kinds.clear();
    share(backend_, count, 8, [&](Index begin, Index end) {  // freeing takes a while too
      for (Index i = begin; i < end; ++i) scenes[std::size_t(i)].plan.reset();
    });
    say(settled);
  }
}

}  // namespace bromwich
