#pragma once
// The methods on one grid: the discretisation that each one uses for a given scene, and its run.

#include "../kernel/prepared_method.hpp"
#include "../kernel/shared_dynamics.hpp"
#include "../kernel/time_operator.hpp"
#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scan/chunk_scan.hpp"

#include <map>
#include <memory>
#include <optional>

namespace bromwich {

struct ImpactRows;

/// A scene on a grid, with the plans and tables that its methods share. They are made on first use.
class Methods {
 public:
  /// `family`: what this grid shares with others; null: nothing yet.
  Methods(const Scene&, Backend&, Index J, const std::vector<Index>& components, bool look_inside_every_step = false,
          std::shared_ptr<GridFamily> family = nullptr);

  /// From now on keeps what a method has prepared for its next run.
  void keep_prepared();
  /// The scene has other x0, f or g than before.
  void renew(const Changes&);

  /// Fills `result`, states included, except for the total times.
  void run(Method, const InnerOptions&, Result& result);

  /// All states of a dense scene after a run of `method` that gave `result`: (J+1) x m. For m <= most_recorded_states.
  RowMatrix all_states(Method, const Result& result) const;
  static constexpr Index most_recorded_states = 64;
  /// Dense dynamics with at most so many states.
  static bool has_small_dense_state(const Scene&);

  /// Notices of sources that the grid does not resolve.
  void tell_sources(Result&) const;

  const DiscreteProblem& problem() const { return problem_; }
  const std::shared_ptr<GridFamily>& family() const { return family_; }
  bool looks_inside_every_step() const { return look_inside_every_step_; }
  /// Whether continuous piecewise-linear y is safe here.
  const BasisChoice& basis() { return operator_->basis(); }

 private:
  struct MethodOfSteps {
    Method method;
    bool y_is_line;  ///< it needs a continuous piecewise-linear y
    void (Methods::*run)(const InnerOptions&, Result&);
  };
  static const MethodOfSteps& row_of(Method);

  std::optional<ScanPlan> plan_of_march(const InnerOptions&) const;
  void march(const InnerOptions&, Result&);
  void shoot(const InnerOptions&, Result&);
  void march_by_weights(const InnerOptions&, Result&);
  double surplus_of_start(Method, const Result&) const;
  void judge_start(Method, Result&) const;
  bool divides_in_stages() const;
  void step_in_stages(Index stages, const InnerOptions&, Result&, const ScanPlan* plan = nullptr);
  void step_over_impacts(const ImpactRows&, const InnerOptions&, Result&);
  void keep_recorded(Result&);
  void step_by_euler(const InnerOptions&, Result&);
  void iterate(const InnerOptions&, Result&);
  void iterate_literally(const InnerOptions&, Result&);
  void cycle(const InnerOptions&, Result&);
  void cycle_in_w_alone(const InnerOptions&, Result&);
  void keep_all_states(Result&);
  bool cycle_in_w(Method, const Options&, Result&);
  void report_sources(Result&) const;
  void average_sources();
  TimeOperator& operator_of(Method) const;
  /// Runs what `prepare` makes, or has made for the same method before. False where it makes nothing.
  bool run_prepared(Method, const Options&, Result&, const std::function<std::unique_ptr<PreparedMethod>()>& prepare);
  void record_states(Method, Result&);

  std::shared_ptr<GridFamily> family_;
  DiscreteProblem problem_;
  std::optional<DiscreteProblem> averaged_;                  ///< of implicit Euler, where steps are rough
  std::unique_ptr<TimeOperator> operator_, euler_operator_;  ///< the second where steps are rough
  struct Kept {
    std::unique_ptr<PreparedMethod> method;
    Changes due = no_changes;  ///< of the problem since the last run
  };
  std::map<Method, Kept> kept_;
  bool keeps_ = false, look_inside_every_step_ = false;
  RowMatrix stage_states_;  ///< all states of the last run in stages, where there are few
};

/// A notice of sources that a grid misses by so much, NaN if it is not known, around t.
void tell_sources(double missed, double t, Result&);

}  // namespace bromwich
