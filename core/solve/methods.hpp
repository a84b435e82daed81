#pragma once
// One method on one grid: which discretisation it stands for on a given scene, and its run.

#include "../kernel/prepared_method.hpp"
#include "../kernel/time_operator.hpp"
#include "../result/inner_options.hpp"
#include "../result/result.hpp"

#include <map>
#include <memory>
#include <optional>

namespace bromwich {

/// A scene on a grid with what its methods share, made when first asked for.
class Methods {
 public:
  Methods(const Scene&, Backend&, Index J, const std::vector<Index>& components, bool look_inside_every_step = false);

  /// From now on what a method has prepared is kept for its next run.
  void keep_prepared();
  /// The scene has other x0, f or g than before.
  void renew(const Changes&);

  /// Fills everything of `result` but times of the whole, states included.
  void run(Method, const InnerOptions&, Result& result);

  /// All states of a dense scene after a run of `method` that gave `result`: (J+1) x m. For m <= most_recorded_states.
  RowMatrix all_states(Method, const Result& result) const;
  static constexpr Index most_recorded_states = 64;
  /// Dense dynamics with at most so many states.
  static bool has_small_dense_state(const Scene&);

  const DiscreteProblem& problem() const { return problem_; }
  /// Whether continuous piecewise-linear y is safe here.
  const BasisChoice& basis() { return operator_->basis(); }

 private:
  void march(const InnerOptions&, Result&);
  void step_in_stages(Index stages, const InnerOptions&, Result&);
  void iterate(const Options&, Result&);
  void cycle(const Options&, Result&);
  void keep_all_states(Result&);
  bool cycle_in_w(Method, const Options&, Result&);
  void report_sources(Result&) const;
  void average_sources();
  TimeOperator& operator_of(Method) const;
  /// Runs what `prepare` makes, or has made for the same method before. False where it makes nothing.
  bool run_prepared(Method, const Options&, Result&, const std::function<std::unique_ptr<PreparedMethod>()>& prepare);
  void record_states(Method, Result&);

  DiscreteProblem problem_;
  std::optional<DiscreteProblem> averaged_;                  ///< of implicit Euler, where steps are rough
  std::unique_ptr<TimeOperator> operator_, euler_operator_;  ///< the second where steps are rough
  struct Kept {
    std::unique_ptr<PreparedMethod> method;
    Changes due = no_changes;  ///< what the problem has got since
  };
  std::map<Method, Kept> kept_;
  bool keeps_ = false, look_inside_every_step_ = false;
  RowMatrix stage_states_;  ///< all states of the last run in stages, where there are few
};

}  // namespace bromwich
