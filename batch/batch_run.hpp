#pragma once
// One call of solve_batch: results of all scenes, filled group by group, in lanes where that is possible
// (batch/lane_march.hpp), otherwise by single solves, several at once where that is allowed.

#include "../core/base/first_touch.hpp"
#include "../core/seam/scene_march.hpp"
#include "batch.hpp"
#include "batch_arrays.hpp"
#include "lane_march.hpp"
#include "side_by_side.hpp"
#include "single_solves.hpp"

#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich {

class BatchRun {
 public:
  BatchRun(const Batch&, Backend&, const Options&, const MakeBackend& another);
  /// `fill`: with rows of NaN for scenes that were not reached; otherwise y, w and x end with the last one that was.
  /// Rows of w that can be computed from y and x are left out then, and marked in BatchResult::w_is_due.
  BatchResult run(const std::function<void(const Progress&)>& progress, bool fill = true);

  static constexpr double most_lane_bytes = 256e6;  ///< of the buffers of one thread

 private:
  static constexpr Index lanes = 8;
  static constexpr Index groups_between_polls = 16;             ///< of lanes, for each thread
  static constexpr Index steps_between_polls = Index(1) << 21;  ///< of all scenes, for each thread: about 0.1 s

  // A scene and what its lane starts from.
  struct Prepared {
    Index scene = 0;
    LaneInput input;
  };

  Eigen::Block<RowMatrix> rows_of(RowMatrix& all, Index k) {
    return all.rows() > 0 ? all.block(k * rows_, 0, rows_, all.cols()) : all.block(0, 0, 0, 0);
  }
  bool has_all_states(const Scene&) const;  ///< x of the result, in order
  void keep_on_backend(const Scene& first);
  void say(Index more);
  bool asked_to_stop();
  Index scenes_between_polls() const;

  bool for_lanes() const;
  void take_lanes(const std::vector<Index>& group);
  std::vector<NaturalUnits> units_of(const std::vector<Index>& group);
  void march_group(const LanePlan&, const std::vector<Index>& group);
  bool input_of(const LanePlan&, Index k, LaneInput&) const;
  struct OwnPlans;
  // A plan of one scene.
  struct Planned {
    std::unique_ptr<LanePlan> plan;
    LaneInput input;
  };
  std::optional<OwnPlans> common_of_plans(const std::vector<Index>& scenes) const;
  void plan_with_samples(const OwnPlans&, Index k, Scene&, Planned&) const;
  void plan_with_own_sources(const OwnPlans&, Index k, Planned&) const;
  void take_own(const std::vector<Index>& scenes);
  // Scenes for a device: their first rows and plans.
  struct DeviceStarts {
    RowMatrix x0, y0, plans;
    std::vector<char> found, other;
  };
  bool marches_on_device(const LanePlan&, Index scenes) const;
  DeviceStarts starts_of(const SceneMarchProblem&, const Prepared*, Index count) const;
  std::vector<Index> march_on_device(const LanePlan&, const std::vector<Index>& group);
  std::vector<Prepared> march_own_on_device(std::vector<Prepared>);
  std::vector<Prepared> march_on_device(SceneMarchProblem, std::vector<Prepared>);
  void download_rows(SceneMarch&, bool whole, RowMatrix& y, RowMatrix& x);
  void keep_rows(const LaneInput&, Index k, Index i, bool whole, const RowMatrix& y, const RowMatrix& x);
  void keep_in_arrays(SceneMarch&, const Prepared*, const std::vector<char>& settled);
  Index march(const std::vector<Prepared>&);
  Index march_range(LaneMarch&, const Prepared* first, Index count);
  void keep(const LaneMarch&, Index lane, Index k, const LaneOutcome&);

  void take_singly(const std::vector<Index>& scenes, bool shares);
  bool may_be_side_by_side(const Scene&) const;
  void settle(Index k, double residual, bool other_at_zero);

  const Batch& batch_;
  Backend& backend_;
  Options options_;
  Index J_, rows_, count_ = 0;    ///< rows_: of a scene in the result
  std::vector<Index> grid_rows_;  ///< the time points of these rows; empty: they are not on the grid
  bool own_sources_, stopped_ = false;
  std::function<void(const Progress&)> progress_;
  std::vector<char> done_;
  BatchResult result_;
  bool w_comes_later_ = false;           ///< of scenes that are stepped side by side: from their y and x
  std::shared_ptr<BatchArrays> arrays_;  ///< where results stay on the backend
  SingleSolves alone_;
  const MakeBackend another_;
  std::optional<SideBySide> side_by_side_;  ///< made when it is needed first
  std::deque<FirstTouch> touch_;            ///< of y and x while a device works; ends before they are written
};

}  // namespace bromwich
