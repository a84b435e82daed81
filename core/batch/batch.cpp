#include "core/batch/batch.hpp"

#include "core/base/error.hpp"
#include "core/base/require.hpp"
#include "core/base/text.hpp"
#include "core/batch/batch_groups.hpp"
#include "core/batch/batch_run.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

constexpr double default_block_bytes = 1e9;
constexpr Index most_steps = Index(1) << 24;  ///< as core/solve/solve.cpp

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

Batch part_of(const Batch& b, Index first, Index count) {
  Batch part;
  part.common = b.common;
  part.times = b.times;
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
  const double T = own.empty() ? common.T : own.front().T;
  for (std::size_t i = 0; i < times.size(); ++i)
    if (!(times[i] >= (i > 0 ? times[i - 1] : 0)) || !(times[i] <= T))
      throw Error("times", text("has %.6g at %zu", times[i], i), text("give times in order, from 0 to T = %.6g", T));
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
  if (!b.f.empty() || !b.g.empty() || !b.breakpoints.empty()) scene.breakpoints_are_all = false;
  scene.exact = {};
  return scene;
}

Index BatchResult::solved() const { return std::count(status.begin(), status.end(), Status::solved); }

double predicted_bytes(const Batch& b, const Options& options, Index scenes, int threads) {
  const Scene& scene = first_of(b);
  const double steps = double(steps_of(scene, options)), rows = b.times.empty() ? steps + 1 : double(b.times.size()),
               n = double(scene.constraints());
  const double columns = n * (options.trace ? 2 : 1) + double(recorded_components(scene, options).size());
  const double of_lanes = LaneMarch::bytes(scene.states(), scene.constraints(), Index(steps));
  return sizeof(double) * rows * columns * double(scenes) + 200.0 * double(scenes) +
         (of_lanes <= BatchRun::most_lane_bytes ? of_lanes * double(threads) : 0);
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
