// Scenes of a batch with matrices of their own, eight at a time in lanes.

#include "core/base/error.hpp"
#include "core/batch/batch_groups.hpp"
#include "core/batch/batch_run.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <map>
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

}  // namespace

// Scenes that share neither dynamics nor M: a plan each.
void BatchRun::take_own(const std::vector<Index>& all) {
  const Index together = lanes * groups_between_polls * std::max(1, backend_.threads());
  NaturalUnits nearby;
  bool has_units = false;
  std::optional<SampledSources> common;
  for (std::size_t first = 0; first < all.size() && !stopped_; first += std::size_t(together)) {
    std::vector<Index> scenes;
    std::vector<Scene> stated;
    for (std::size_t i = first; i < std::min(all.size(), first + std::size_t(together)); ++i) try {
        Scene scene = scene_of(batch_, all[i]);
        scene.validate();
        stated.push_back(std::move(scene));
        scenes.push_back(all[i]);
      } catch (const Error&) {  // the single solve says so
      }
    std::vector<std::unique_ptr<LanePlan>> plans(scenes.size());
    if (!has_units && !stated.empty()) {
      nearby = natural_units(stated.front()), has_units = true;
      if (!own_sources_) {
        common = sampled(stated.front(), J_);
        if (!common) return;
      }
    }
    const Index count = Index(scenes.size());
    const Index length = backend_.traits().one_at_a_time ? 1 : std::max<Index>(1, count);  // a device has one stream
    share(backend_, count, length, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) try {
          std::string why;
          plans[std::size_t(i)] = LanePlan::make(stated[std::size_t(i)], backend_, J_, true, &nearby, why);
        } catch (const Error&) {
        }
    });
    std::map<Kind, std::vector<Prepared>> kinds;
    for (std::size_t i = 0; i < scenes.size(); ++i) try {
        if (plans[i] && plans[i]->stages)
          if (const NaturalUnits units = natural_units(stated[i]); !same_units(units, plans[i]->units)) {
            std::string why;
            plans[i] = LanePlan::make(stated[i], backend_, J_, true, &units, why);
          }
        if (!plans[i]) continue;
        auto sources = common && !plans[i]->stages ? plans[i]->sources_at_points(common->g, common->f)
                                                   : plans[i]->sources_of(stated[i]);
        if (!sources) continue;
        LaneInput input{plans[i].get(), plans[i]->start_of(stated[i].x0),
                        std::make_shared<const LaneSources>(std::move(*sources))};
        kinds[kind_of(*plans[i])].push_back({scenes[i], std::move(input)});
      } catch (const Error&) {  // the single solve says so
      }
    Index settled = 0;
    for (const auto& [kind, same] : kinds) settled += march(same);
    say(settled);
  }
}

}  // namespace bromwich
