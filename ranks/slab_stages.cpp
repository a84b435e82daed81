#include "ranks/slab_stages.hpp"

#include "ranks/slab_convolution.hpp"
#include "ranks/slab_plans.hpp"

#include <utility>

namespace bromwich {

namespace {

// Whether the rows here of an array with both stages and of one with the ends of steps are those of the same steps.
bool alike(const Array& stages, const Array& ends) {
  const Slabs &fine = slab(stages).slabs, &coarse = slab(ends).slabs;
  return (fine.whole() && coarse.whole()) || aligned(fine, coarse);
}

// The plan of a grid that is held as a whole, or so short that its ends of steps are; null for others.
template <class Make>
std::unique_ptr<Convolution> short_convolution(const RankedBackend& ranked, Index n, Index rows, Make make) {
  const Slabs slabs = slabs_of(rows, ranked.communicator), ends = slabs_of((rows - 1) / 2 + 1, ranked.communicator);
  if (!slabs.whole() && !ends.whole()) return nullptr;
  return make_whole_convolution(ranked, make(), slabs, n);
}

}  // namespace

StageOperations slab_stages(const RankedBackend& ranked, const StageOperations& by_host) {
  StageOperations all;
  all.take_stages = [ranked, by_host](const Array& stages, Array& first, Array& second) {
    if (!alike(stages, first)) return by_host.take_stages(stages, first, second);
    ranked.local.take_stages(local_part(stages), local_part(first), local_part(second));
  };
  all.put_stages = [ranked, by_host](const Array& first, const Array& second, Array& stages) {
    if (!alike(stages, first)) return by_host.put_stages(first, second, stages);
    ranked.local.put_stages(local_part(first), local_part(second), local_part(stages));
  };
  all.sweep_stages = [ranked](const StageDivisors& d, const Array& r, const Array& v, Array& y) {
    ranked.local.sweep_stages(d, local_part(r), local_part(v), local_part(y));
  };
  all.restrict_stages = [ranked, by_host](const Array& r, const Array& v, const Array& y, const Array& coarse_v,
                                          Array& coarse_r, Array& coarse_y, Array& old) {
    if (!alike(y, coarse_y)) return by_host.restrict_stages(r, v, y, coarse_v, coarse_r, coarse_y, old);
    ranked.local.restrict_stages(local_part(r), local_part(v), local_part(y), local_part(coarse_v),
                                 local_part(coarse_r), local_part(coarse_y), local_part(old));
  };
  all.stage_convolution = [ranked](const StageRecurrence& r, Index rows) -> std::unique_ptr<Convolution> {
    if (auto whole =
            short_convolution(ranked, r.modes(), rows, [&] { return ranked.local.stage_convolution(r, rows); }))
      return whole;
    return make_slab_convolution(ranked, r, slabs_of(rows, ranked.communicator));
  };
  all.stage_tables = [ranked](StageWeights parts, Index n, Index rows) {
    return short_convolution(ranked, n, rows, [&] { return ranked.local.stage_convolution(parts, n, rows); });
  };
  return all;
}

}  // namespace bromwich
