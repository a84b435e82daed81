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

// Lanes of one kind can be stepped together.
using Kind = std::tuple<bool, bool, bool, bool, double, double>;
Kind kind_of(const LanePlan& p) { return {p.stages, p.surely_P, p.certain, p.euler.has_value(), p.most_growth, p.h}; }

// f and g at the time points, where they are finite and linear between them.
struct SampledSources {
  RowMatrix g, f;
};
std::optional<SampledSources> sampled(const Scene& scene, Index J) {
  const Vector t = time_grid(scene.T, J);
  const SampledSource g = sample(scene.g, t, scene.constraints()),
                      f = scene.f ? sample(scene.f, t, scene.sources()) : SampledSource();
  if (g.not_finite() >= 0 || f.not_finite() >= 0 || !find_source_steps(scene, t, f, g, false).rough.empty())
    return std::nullopt;
  return SampledSources{g.table(), f.size() > 0 ? RowMatrix(f.table()) : RowMatrix()};
}

// Those of all scenes: where there is no f, plans take them as they are.
class CommonSources {
 public:
  explicit CommonSources(SampledSources of) : of_(std::move(of)) {}

  std::shared_ptr<const LaneSources> in(const LanePlan& plan) {
    if (of_.f.size() > 0) return std::make_shared<const LaneSources>(plan.sources_at_points(of_.g, of_.f));
    const std::lock_guard lock(mutex_);
    std::shared_ptr<const LaneSources>& kept = kept_[plan.euler.has_value()];
    if (!kept) kept = std::make_shared<const LaneSources>(plan.sources_at_points(of_.g, of_.f));
    return kept;
  }

 private:
  SampledSources of_;
  std::mutex mutex_;
  std::array<std::shared_ptr<const LaneSources>, 2> kept_;  // without and with a search for other solutions
};

// A scene and its plan; none where a single solve has to look at it.
struct OwnScene {
  Index number;
  Scene scene;
  std::unique_ptr<LanePlan> plan;
  std::shared_ptr<const LaneSources> sources;
};

// What calls functions of the user: natural units of stages, sources of the scene.
void add_sources(OwnScene& own, Backend& backend, Index J) {
  if (own.plan->stages)
    if (const NaturalUnits units = natural_units(own.scene); !same_units(units, own.plan->units)) {
      std::string why;
      own.plan = LanePlan::make(own.scene, backend, J, true, &units, why);
      if (!own.plan) return;
    }
  if (auto sources = own.plan->sources_of(own.scene))
    own.sources = std::make_shared<const LaneSources>(std::move(*sources));
}

}  // namespace

// Scenes that share neither dynamics nor M: a plan each.
void BatchRun::take_own(const std::vector<Index>& all) {
  const Index together = scenes_between_polls();
  std::optional<NaturalUnits> nearby;
  std::optional<CommonSources> common;
  for (std::size_t first = 0; first < all.size() && !stopped_; first += std::size_t(together)) {
    std::vector<OwnScene> scenes;
    for (std::size_t i = first; i < std::min(all.size(), first + std::size_t(together)); ++i) try {
        Scene scene = scene_of(batch_, all[i]);
        scene.validate();
        scenes.push_back({all[i], std::move(scene), nullptr, nullptr});
      } catch (const Error&) {  // the single solve says so
      }
    if (!nearby && !scenes.empty()) {
      nearby = natural_units(scenes.front().scene);
      if (!own_sources_) {
        auto of = sampled(scenes.front().scene, J_);
        if (!of) return;
        common.emplace(std::move(*of));
      }
    }
    const Index count = Index(scenes.size());
    const Index length = backend_.traits().one_at_a_time ? 8 : std::max<Index>(1, count);  // a device has one stream
    share(backend_, count, length, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) try {
          OwnScene& own = scenes[std::size_t(i)];
          std::string why;
          own.plan = LanePlan::make(own.scene, backend_, J_, true, &*nearby, why);
          if (own.plan && common && !own.plan->stages) own.sources = common->in(*own.plan);
        } catch (const Error&) {  // the single solve says so
        }
    });
    std::map<Kind, std::vector<Prepared>> kinds;
    for (OwnScene& own : scenes) try {
        if (own.plan && !own.sources) add_sources(own, backend_, J_);
        if (own.plan && own.sources)
          kinds[kind_of(*own.plan)].push_back(
              {own.number, {own.plan.get(), own.plan->start_of(own.scene.x0), own.sources}});
      } catch (const Error&) {  // the single solve says so
      }
    Index settled = 0;
    for (const auto& [kind, same] : kinds) settled += march(same);
    kinds.clear();
    share(backend_, count, 8, [&](Index begin, Index end) {  // freeing takes a while too
      for (Index i = begin; i < end; ++i) scenes[std::size_t(i)].plan.reset();
    });
    say(settled);
  }
}

}  // namespace bromwich
