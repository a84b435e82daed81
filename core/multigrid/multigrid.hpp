#pragma once
// Multigrid in time for 0 <= y  ⊥  M y + K y + r >= 0: a full approximation scheme with the functional iteration as its
// smoother. On a grid, with R the values at the points of the next coarser one and I the linear interpolation back:
//
//     smooth          y <- SOL(M, r + K y)
//     coarse problem  y_c in SOL(M, r_c + K_c y_c),   r_c = R (r + K y) - K_c R y
//     correct         y <- y + I (y_c - R y)
//     smooth
//
// R y of a solution y solves its coarse problem, so that y is left as it is. R has to be injection: averages of y and w
// over time are not complementary where the active set changes. On the coarsest grid there are only sweeps, or, where
// these do not do, it is marched. The start comes from the coarse grids (nested iteration). K_c R y serves the coarse
// problem and the first sweep on it.
//
// The correction y_c - R y is, up to what the coarse problem is solved to, the error of R y: it estimates what the
// cycle found. What a cycle leaves is estimated by two parts,
//
//     rho/(1 - rho) |y_c - R y|   of what the coarse grid sees, rho the quotient of two corrections in turn, and
//     f/(1 - f) |S y - y|         of what it does not, S the last sweep and f = TimeLevel::unseen.

#include "time_levels.hpp"

namespace bromwich {

class Multigrid {
 public:
  Multigrid(Backend& backend, const Options& options, TimeLevels& levels);

  /// Of a solve, whose counters, sweeps and seconds go to `result`; both have to outlive it.
  void begin(const Options& options, Result& result);

  /// From y_0 alone to a first y on the finest grid. A device may still be at work when this returns.
  void nest(const Vector& y0);

  /// Cycles on the finest grid until y stands still, or, with Options::algebraic_share, as long as they are useful. For
  /// the latter there have to be three grids.
  IterationOutcome iterate();

  /// Estimated from y on the finest grid after the last cycle and what the nested iteration came to on the two below,
  /// relative to max(1, |y|) of a time point. Nothing where there are fewer, or where they do not come together.
  std::optional<double> discretisation_error();

  /// One V-cycle for the y and r that grid l holds.
  void cycle(std::size_t l);

 private:
  /// The differences that a solve looks at on the finest grid: the last change by a cycle, or its correction; that by
  /// the last sweep; |y_h - y_2h| and |y_2h - y_4h|.
  enum Slot : std::size_t { last_change, last_sweep, half_step, quarter_step, slots };

  // If all plans of all grids are asynchronous, a cycle never synchronises; failures are detected afterwards and the
  // cycle is repeated synchronously.
  bool all_queue() const;
  bool collected();
  bool watched(const std::function<void()>& work);
  void whole_cycle();
  void look_for_correction();
  void correct_finest();
  void one_more_sweep();
  void measure_correction();
  void compare();
  bool march_from_now_on();
  double useful_error();
  double unseen();
  bool useful(double seen, int sweeps);

  bool left_out_of_start(std::size_t l) const;
  void start_on(std::size_t l, std::size_t last, const Vector& y0);
  void nest_on(std::size_t l);
  void solve_on(std::size_t l);  // v holds K y
  void sweep_coarsest();
  void descend(std::size_t l);
  void pose(std::size_t l);
  void ascend(std::size_t l);
  void sweep(TimeLevel&, SweepOrder);
  void apply(TimeLevel&);
  void smooth(TimeLevel&);
  void march(TimeLevel&);
  void count(const LcpCount&);
  void judge(const LcpReport&);
  void judge(const MarchReport&, Index steps);

  /// The two halves of a cycle on one grid, recorded; empty where operations are called one by one. On the coarsest
  /// grid `descend` is all.
  struct Recorded {
    std::function<void()> descend, ascend;
  };

  Backend& backend_;
  const Options* options_;
  TimeLevels& levels_;
  Result* result_ = nullptr;
  bool useful_;  ///< cycles end where they are of no further use
  bool queued_, nested_ = false, start_is_solved_ = false;
  std::unique_ptr<Differences> differences_;
  std::vector<Recorded> recorded_;
  Vector y0_;
  std::optional<IterationOutcome> failure_;  ///< what ended a sweep or a march; nothing is done after it
};

/// Its run fills everything that the functional iteration does, cycles and error_estimate too. Null where there are no
/// grids to cycle on.
std::unique_ptr<PreparedMethod> prepare_multigrid(TimeOperator&, const Options&);

}  // namespace bromwich
