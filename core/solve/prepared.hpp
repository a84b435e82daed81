#pragma once
// Data that a Solver keeps from one solve to the next, and a solve to a tolerance from one grid to the next.

#include "../kernel/shared_dynamics.hpp"
#include "../scene/natural_units.hpp"
#include "../scene/scene.hpp"
#include "cost.hpp"
#include "methods.hpp"
#include "mixed.hpp"

#include <functional>
#include <map>
#include <memory>
#include <optional>

namespace bromwich {

/// The methods of one grid.
struct PreparedGrid {
  std::unique_ptr<Scene> scene;  ///< scene of the methods, for example in natural units; null: the stated one
  std::unique_ptr<Methods> methods;
  Changes changes = no_changes;  ///< of the stated scene since the last run of the methods
  Cost cost;                     ///< predicted for them
  bool finite_sources = false;   ///< those of the methods; false: not known
};

/// The reductions that replace the dynamics of a scene.
enum class ReducedDynamics { units, mass, written_out, free_rows, symmetric };

struct Prepared {
  std::optional<NaturalUnits> units;    ///< of the first solve, used by all later ones
  bool units_may_change = false;        ///< those of the last solve instead: with others nothing is kept
  const Scene* stated = nullptr;        ///< the scene of the Solver; null: there is none, and no methods are kept
  std::map<Index, PreparedGrid> grids;  ///< by the number of steps

  /// Of x0 or sources of the stated scene.
  void add(const Changes& changes) {
    for (auto& [steps, grid] : grids) grid.changes.add(changes);
  }

  /// The units of a solve, which are `now` where they may change.
  const NaturalUnits& units_of_solve(const std::function<NaturalUnits()>& now);

  /// `made`, or the dynamics that the same reduction has made of `given` before, so that grids keep the data that they
  /// share.
  Dynamics reduced(ReducedDynamics, const Dynamics& given, const Dynamics& made);

  /// Free rows of `scene` eliminated; made once for all grids of a solve. Null as eliminate_free.
  const EliminatedScene* without_free_rows(const Scene& scene);
  /// x0 and the sources of a scene may change from here on.
  void end_of_solve() { eliminated_from_ = nullptr; }

 private:
  std::map<ReducedDynamics, std::pair<Dynamics, Dynamics>> reduced_;  ///< given, made
  const Scene* eliminated_from_ = nullptr;
  std::optional<EliminatedScene> eliminated_;
};

}  // namespace bromwich
