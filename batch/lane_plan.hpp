#pragma once
// The data that the scenes of a group of lanes share: the maps of a step, the problems of its active sets, sampled
// sources. See core/host/scene_steps.hpp for the steps and batch/lane_march.hpp for their use.

#include "../core/host/stage_problem.hpp"
#include "../core/kernel/discrete_problem.hpp"
#include "../core/kernel/shared_dynamics.hpp"
#include "../core/scene/natural_units.hpp"
#include "active_set_table.hpp"

#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

inline constexpr Index most_lane_states = 32;

/// The step, or a part of one.
struct StepMaps {
  Matrix E, L, R;
  std::unique_ptr<ActiveSetTable> problem;  ///< M + N R, or M where y jumps; with stages D (I ⊗ M + W)
};

struct PartOfStep {
  const StepMaps* maps = nullptr;
  bool moves = true;  ///< false: y jumps with g, x stays
  Vector drift, g;
};

/// The problems of implicit Euler, in whose steps a single solve looks for other solutions
/// (core/accuracy/other_solution.hpp): q = N D (x_{j-1} + h f_j) + g_j, D = (I - hA)^{-1}.
struct EulerSearch {
  Matrix seen;               ///< n x m, N D
  std::vector<RowMatrix> V;  ///< of all active sets, see ActiveSetTable; in the units of the scene
};

/// The rule by which perturbations of the state grow (core/accuracy/magnification.hpp): dz_j = E dz_{j-1} + G dy_j.
struct GrowthMaps {
  Matrix E, R, G;                 ///< m x m, m x n, m x n
  const ActiveSetTable* problem;  ///< M + N R
};

/// Tables over time of one scene, in the units of its plan: (J+1) rows each.
struct LaneSources {
  RowMatrix drift;                      ///< m: d_j
  RowMatrix g;                          ///< n, with stages 2n: g_j
  RowMatrix f;                          ///< m, where other solutions are looked for: f itself
  RowMatrix at_points;                  ///< n, with stages: g at the time points; otherwise g has it
  RowMatrix growth_drift;               ///< m, with stages: d_j of implicit Euler; otherwise drift has it
  std::optional<StageProblem> problem;  ///< with stages
};

/// Samples of f and g that scenes with plans of their own share, in the units of the scenes: (J+1) rows each.
struct SourceSamples {
  /// None where sources are not finite or not smooth.
  static std::optional<SourceSamples> of(const Scene&, Backend&, Index J);

  RowMatrix g, g_stages;  ///< n, and 2n at the stages of the step to t_j
  RowMatrix f, f_ends,
      f_stages;  ///< k at the time points, 2k at the ends of the step to t_j, 2k at its stages; or empty
};

/// What a plan makes of SourceSamples, in its own units.
struct SourceMaps {
  RowMatrix drift, q;   ///< m x 2k, and with stages 2n x 2k
  RowMatrix growth, f;  ///< m x k: with stages, growth_drift; where other solutions are looked for, f itself
  Vector g;             ///< n: with stages, the factors of g
};

/// y_0 of a scene.
struct LaneStart {
  bool found = false;  ///< the problem at t = 0 is solved
  bool other = false;  ///< it has another solution
  Vector y;
};

/// Made from one scene of the group.
class LanePlan {
 public:
  /// Empty, with the reason in `why`, where lanes cannot take the steps of a single solve. With `own_sources`, f and g
  /// of the scene are not read. `units`: the natural ones of a scene nearby; null: those of this one.
  static std::unique_ptr<LanePlan> make(const Scene&, Backend&, Index J, bool own_sources, const NaturalUnits* units,
                                        std::string& why);

  /// The number of time points that continuous solutions may keep this active set, before a mode appears that the steps
  /// do not resolve.
  double longest(unsigned set) const;
  GrowthMaps growth() const;
  /// The tables of a scene with sources of its own; empty where they are not finite or not smooth.
  std::optional<LaneSources> sources_of(const Scene&) const;
  /// With stages: the problem of steps that are taken singly.
  StageProblem stage_problem(const SourceSamples&) const;
  /// x0 of a scene in the units of the plan.
  Vector start_of(Vector x0) const;
  /// y_0 from x0 and g(0), both in these units.
  LaneStart start(const Vector& x0, const Vector& g) const;

  Index m, n, J;
  double h;
  bool stages = false;  ///< Radau IIA
  LcpClass lcp_class = LcpClass::unknown;
  bool least_elements = false, surely_P = false, certain = true;
  double most_growth = 50;  ///< of perturbations, half of what a single solve accepts
  Matrix A, B, N, M;
  StepMaps whole;
  Matrix euler_E, euler_R;                         ///< with stages: of implicit Euler, m x m and m x n
  std::unique_ptr<ActiveSetTable> euler_problem;   ///< with stages: M + N euler_R
  std::unique_ptr<ActiveSetTable> at_zero;         ///< M alone
  std::optional<OtherSolutions> others;            ///< of the problem at t = 0, where a single solve looks for them
  std::optional<EulerSearch> euler;                ///< where it looks for other solutions of the steps as well
  LaneSources sources;                             ///< shared ones
  SourceMaps maps;                                 ///< of samples, without shared ones
  std::map<Index, std::vector<PartOfStep>> parts;  ///< of rough steps
  std::deque<StepMaps> maps_of_parts;
  NaturalUnits units;                    ///< with stages: those of all that is above; otherwise trivial
  std::unique_ptr<const Scene> natural;  ///< the scene in natural units
  unsigned rigid = 0;                    ///< bits of StageSteps::rigid

 private:
  LanePlan() = default;
  bool take_continuous(const DiscreteProblem&, bool own_sources, std::string& why);
  bool take_stages(const DiscreteProblem&, bool own_sources, std::string& why);
  bool look_for_others(std::string& why);
  bool add_parts(const DiscreteProblem&, std::string& why);
  void to_units_of(const Scene&, const NaturalUnits&);
  void make_tables();
  std::unique_ptr<ActiveSetTable> problem_of(const Matrix&) const;
  double limit_of(unsigned set) const;
  void make_maps(const Scene&);
  LaneSources tables(const DiscreteProblem&) const;

  std::shared_ptr<GridFamily> family_;
  Backend* backend_ = nullptr;
  Matrix F_, drive_left_, drive_right_;  ///< of f, and of its values at the ends of a step
  bool has_f_ = false;
  Matrix push_, seen_push_;  ///< with stages, of its values there: DenseStageMaps
  mutable std::mutex mutex_;
  mutable std::map<unsigned, double> longest_;
};

/// What one lane starts from. Its sources are own ones, maps of samples, or those of the plan.
struct LaneInput {
  const LanePlan* plan = nullptr;
  Vector x0;  ///< in the units of the plan
  std::shared_ptr<const LaneSources> sources = {};
  const SourceSamples* samples = nullptr;

  const LaneSources& tables() const { return sources ? *sources : plan->sources; }
  Vector g_at(Index j) const;  ///< at a time point, in the units of the plan
};

}  // namespace bromwich
