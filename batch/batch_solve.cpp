#include "batch/batch.hpp"
#include "batch/batch_groups.hpp"
#include "batch/batch_run.hpp"
#include "batch/stopped_batch.hpp"
#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/threads.hpp"
#include "core/scene/input_samples.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double default_block_bytes = 1e9;
constexpr Index most_steps = Index(1) << 24;  ///< as core/solve/solve.cpp

// Options that the lanes read; a single solve looks at the others.
void validate_options(const Batch& batch, const Options& options) {
  if (options.steps < 0 || options.steps > most_steps)
    throw Error("steps", "found " + std::to_string(options.steps), "give a whole number from 1 to 16777216");
  for (const Index c : options.components)
    if (c < 0 || c >= first_of(batch).states())
      throw Error("states", "component " + std::to_string(c) + " of " + std::to_string(first_of(batch).states()),
                  "components are counted from 0");
  if (controls_error(options) && batch.times.empty())
    throw Error("tolerance", "is given to a batch without times", "give times, at which all scenes have rows");
  if (options.method == Method::goal)
    throw Error("method", "found goal for a batch", "use another method: its grids differ from scene to scene");
}

// Scenes with rows at times of their own can be solved to a tolerance; the rows of others are those of one grid.
Options options_of(const Batch& batch, const Options& given) {
  return batch.times.empty() ? given : with_defaults(given, first_of(batch));
}

Batch part_of(const Batch& b, Index first, Index count) {
  Batch part;
  part.common = b.common;
  part.times = b.times;
  part.same_sources = b.same_sources;
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

double predicted_bytes(const Batch& b, const Options& options, Index scenes, int threads) {
  const Scene& scene = first_of(b);
  const double steps = double(steps_of(scene, options)), rows = b.times.empty() ? steps + 1 : double(b.times.size()),
               n = double(scene.constraints());
  const double columns = n * (options.trace ? 2 : 1) + double(recorded_components(scene, options).size());
  const bool small = scene.states() <= most_lane_states && scene.dynamics->small_state();
  const double of_lanes = small ? LaneMarch::bytes(scene.states(), scene.constraints(), Index(steps)) : 0;
  return sizeof(double) * rows * columns * double(scenes) + 200.0 * double(scenes) +
         (of_lanes <= BatchRun::most_lane_bytes ? of_lanes * double(threads) : 0);
}

namespace {

BatchResult solved_batch(const Batch& batch, Backend& backend, const Options& given, const MakeBackend& another,
                         bool fill) {
  batch.validate();
  const Options options = options_of(batch, given);
  validate_options(batch, options);
  const double bytes = predicted_bytes(batch, options, batch.scenes, backend.threads());
  if (options.memory_limit > 0 && bytes > options.memory_limit)
    throw Error("memory_limit", text("%ld scenes are predicted to need %.3g bytes", long(batch.scenes), bytes),
                "raise it, record fewer states, or solve in blocks", ErrorKind::does_not_fit);
  return BatchRun(batch, backend, options, another).run(options.progress, fill);
}

}  // namespace

BatchResult solve_batch(const Batch& batch, Backend& backend, const Options& options, const MakeBackend& another) {
  return solved_batch(batch, backend, options, another, true);
}

BatchResult solve_batch_until_stopped(const Batch& batch, Backend& backend, const Options& options,
                                      const MakeBackend& another) {
  return solved_batch(batch, backend, options, another, false);
}

void add_missing_rows(BatchResult& r) {
  const Index rows = r.scenes * r.rows();
  for (RowMatrix* all : {&r.y, &r.w, &r.x}) {
    const Index missing = rows - all->rows();
    if (missing == 0 || all->size() == 0) continue;  // not recorded
    all->conservativeResize(rows, Eigen::NoChange);
    all->bottomRows(missing).setConstant(NAN);
  }
}

void add_rows_of_w(const Batch& batch, const HostThreads& threads, BatchResult& r) {
  if (std::none_of(r.w_is_due.begin(), r.w_is_due.end(), [](char due) { return due != 0; })) return r.w_is_due.clear();
  const auto g_of = [&](const Scene& scene) {
    return scene.g ? RowMatrix(sample(scene.g, r.t * (scene.T / first_of(batch).T), scene.constraints()).table())
                   : RowMatrix(RowMatrix::Zero(r.rows(), scene.constraints()));
  };
  const bool own = own_sources(batch);
  const RowMatrix shared = own ? RowMatrix() : g_of(scene_of(batch, 0));
  const auto add = [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      if (!r.w_is_due[std::size_t(k)]) continue;
      const Scene scene = scene_of(batch, k);
      r.w.middleRows(k * r.rows(), r.rows()) = r.of(r.x, k) * scene.dynamics->small_state()->N.transpose() +
                                               r.of(r.y, k) * to_dense(scene.M).transpose() +
                                               (own ? g_of(scene) : shared);
    }
  };
  own ? add(0, r.scenes) : share(threads, r.scenes, 16, add);
  r.w_is_due.clear();
}

Index solve_in_blocks(const Batch& batch, Backend& backend, const Options& given,
                      const std::function<void(Index first, const BatchResult&)>& take, const MakeBackend& another) {
  batch.validate();
  const Options options = options_of(batch, given);
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
    const BatchResult result = BatchRun(part_of(batch, first, count), backend, inner, another).run(inner.progress);
    take(first, result);
    if (options.interrupted && options.interrupted()) return blocks + 1;
  }
  return blocks;
}

}  // namespace bromwich
