#pragma once
// March of eight scenes in the lanes of a vector: scenes with the same dynamics, M and grid, and other x0 and sources.
// It takes the steps of method march with continuous piecewise-linear y (core/march/marching.cpp), in parts where
// sources are rough (core/march/split.cpp):
//
//     x~ = E x_{j-1} + L y_{j-1} + d_j,   y_j in SOL(M + N R, N x~ + g_j),   x_j = x~ + R y_j.
//
// symbol   variable          shape   meaning
// E, L, R  StepMaps          m x m, m x n, m x n   of a step, or of a part of one
// d_j      drift             m       contribution of f
// V(S)     ActiveSetTable    n x n   solution of the problem on an active set
//
// A lane is settled if the solution passes, with a margin, each check by which Certification would call it solved
// without another solve: residual, alternating y, growth of perturbations, rounding, impulses of contacts, oscillations
// that the steps do not resolve. Lanes that are not settled are left to a single solve.

#include "../scene/natural_units.hpp"
#include "../solve/methods.hpp"
#include "active_set_table.hpp"

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

inline constexpr Index most_lane_states = 32;

/// The step, or a part of one, of all scenes of a group.
struct StepMaps {
  Matrix E, L, R;
  std::unique_ptr<ActiveSetTable> problem;  ///< M + N R, or M where y jumps
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

/// What the scenes of a group share. Made from one of them.
class LanePlan {
 public:
  /// Empty, with the reason in `why`, where lanes do not do what a single solve does. With `own_sources`, f and g of
  /// the scene are not read.
  static std::unique_ptr<LanePlan> make(const Scene&, Backend&, Index J, bool own_sources, std::string& why);

  /// Whether continuous solutions with this active set have an oscillation that the steps do not resolve.
  bool oscillates(unsigned set) const;

  Index m, n, J;
  double h;
  bool least_elements = false, surely_P = false;
  Vector t;
  Matrix A, B, N, M;
  Matrix F, drive_left, drive_right;  ///< of f, and of its values at the ends of a step
  StepMaps whole;
  std::unique_ptr<ActiveSetTable> at_zero;         ///< M alone
  std::optional<OtherSolutions> others;            ///< of the problem at t = 0, where a single solve looks for them
  std::optional<EulerSearch> euler;                ///< where it looks for other solutions of the steps as well
  RowMatrix drift, g;                              ///< (J+1) x m and n, shared sources
  RowMatrix f;                                     ///< (J+1) x m with `euler`: f itself, shared
  std::map<Index, std::vector<PartOfStep>> parts;  ///< of rough steps
  std::deque<StepMaps> maps_of_parts;

 private:
  LanePlan() = default;
  bool add_parts(const DiscreteProblem&, std::string& why);
  void to_units_of(const Scene&, const NaturalUnits&);
  mutable std::mutex mutex_;
  mutable std::map<unsigned, bool> oscillating_;
};

/// What one lane starts from: x0, and sources of its own or none.
struct LaneInput {
  Vector x0;
  RowMatrix drift, g, f;
};

struct LaneOutcome {
  bool settled = false;
  bool other_at_zero = false;  ///< the problem at t = 0 has another solution
  double residual = 0;
};

/// Steps up to eight scenes; keeps its buffers. One thread.
class LaneMarch {
 public:
  explicit LaneMarch(const LanePlan&);
  ~LaneMarch();
  void run(const std::vector<const LaneInput*>& inputs, std::vector<LaneOutcome>& outcomes);
  /// Rows of one lane after `run`; x: the given components.
  void write_y(Index lane, Eigen::Ref<RowMatrix> y) const;
  void write_w(Index lane, Eigen::Ref<RowMatrix> w) const;
  void write_x(Index lane, const std::vector<Index>& components, Eigen::Ref<RowMatrix> x) const;

  static double bytes(Index m, Index n, Index J) { return 64.0 * double(J + 1) * double(2 * m + 3 * n + 2); }

 private:
  struct State;
  std::unique_ptr<State> s_;
};

}  // namespace bromwich
