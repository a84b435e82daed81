#pragma once
// Multigrid in time for 0 <= y  ⊥  M y + K y + r >= 0: a full approximation scheme with the functional iteration as its
// smoother. On a grid, with R the values at the points of the next coarser one and I the linear interpolation back:
//
//     smooth          y <- SOL(M, r + K y)
//     coarse problem  y_c in SOL(M, r_c + K_c y_c),   r_c = R (r + K y) - K_c R y
//     correct         y <- y + I (y_c - R y)
//     smooth
//
// For a solution y, R y solves its coarse problem, so y is a fixed point. R has to be injection: averages of y and w
// over time are not complementary where the active set changes. On the coarsest grid there are only sweeps, or, if
// these are not enough, it is marched. The start comes from the coarse grids (nested iteration). K_c R y serves the
// coarse problem and the first sweep on it.
//
// A lazy cycle interpolates v = K y as well, v <- v + I (K_c y_c - K_c R y), for the sweep after the correction: one
// application of K less on every grid. Solutions stay fixed points, since both corrections vanish there.
//
// The correction y_c - R y is the error of R y before the cycle, up to the accuracy of the coarse problem. The error
// after the cycle is estimated in two parts,
//
//     rho/(1 - rho) |y_c - R y|   on the coarse grid, rho the ratio of two successive corrections, and
//     f/(1 - f) |S y - y|         invisible to it, S the last sweep and f = TimeLevel::unseen.

#include "time_levels.hpp"
#include "v_cycle.hpp"

namespace bromwich {

class Multigrid {
 public:
  Multigrid(Backend& backend, const Options& options, TimeLevels& levels);

  /// For one solve. Counters, sweeps and seconds are added to `result`; problem and result have to outlive the object.
  void begin(const Options& options, Result& result);

  /// Computes a first y on the finest grid from y_0. A device may still be working when this returns.
  void nest(const Vector& y0);

  /// Cycles on the finest grid until y converges, or, with Options::algebraic_share and three grids, until further
  /// cycles are of no use.
  IterationOutcome iterate();

  /// Discretisation error, estimated from y on the finest grid after the last cycle and from the nested iteration on
  /// the next two, relative to max(1, |y|) of a time point. Empty with fewer grids, or if they do not converge.
  std::optional<double> discretisation_error();

  /// Sets Result::convolutions and passes of the solve.
  void report_work() const { cycle_.report_work(); }

  /// One V-cycle for the y and r of grid l.
  void cycle(std::size_t l) { cycle_.run(l); }

 private:
  /// The differences that a solve checks on the finest grid: the last change by a cycle, or its correction; the change
  /// by the last sweep; |y_h - y_2h| and |y_2h - y_4h|.
  enum Slot : std::size_t { last_change, last_sweep, half_step, quarter_step, slots };

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
  Array& ends_of(std::size_t l);
  void start_on(std::size_t l, std::size_t last, const Vector& y0);
  void nest_on(std::size_t l);

  Backend& backend_;
  const Options* options_;
  TimeLevels& levels_;
  Result* result_ = nullptr;
  bool useful_;  ///< cycles end when they are of no further use
  VCycle cycle_;
  bool nested_ = false, start_is_solved_ = false;
  std::unique_ptr<Differences> differences_;
  Vector y0_;
};

/// Running it sets the same members as the functional iteration, and cycles and error_estimate. Null if there are no
/// grids to cycle on.
std::unique_ptr<PreparedMethod> prepare_multigrid(TimeOperator&, const Options&);

}  // namespace bromwich
