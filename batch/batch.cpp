#include "batch/batch.hpp"

#include "core/base/error.hpp"
#include "core/base/require.hpp"
#include "core/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

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
      for (const auto& [name, found, expected] : {std::tuple("states", own[k].states(), own[0].states()),
                                                  std::tuple("constraints", own[k].constraints(), own[0].constraints()),
                                                  std::tuple("default_steps", own[k].steps(), own[0].steps())})
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

Index BatchResult::solved() const { return std::count(status.begin(), status.end(), Status::solved); }

}  // namespace bromwich
