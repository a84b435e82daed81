#pragma once
// Rows of a grid from an event-driven solution.

#include "../accuracy/other_solution.hpp"
#include "../events/event_driven.hpp"
#include "../march/outcome.hpp"

#include <vector>

namespace bromwich {

/// Rows behind t = 0 whose time is a breakpoint but for rounding.
std::vector<Index> rows_at_breakpoints(const Scene&, const Vector& t);

/// y at these rows for the value that g has there, where x determines it: M of a class with one solution. `x`: all
/// states.
void solve_at_own_values(const Scene&, LcpClass, const std::vector<Index>& rows, const RowMatrix& x, const Vector& t,
                         RowMatrix& y);

class EventRows {
 public:
  /// The grid of J steps. Scene and backend have to outlive the object.
  EventRows(const Scene&, Backend&, Index J);

  /// y, its integral, x, the trace if wanted, t and steps of `result`. Where y or x jump at a point of the grid: the
  /// limit from the left, but at breakpoints before T the side that g is on, or f where g does not jump. Row 0 is y_0
  /// and x0; where the state jumps at t = 0, y and the trace are those after the jump. Rows after `until` of the
  /// solution are NaN. With memories row 0 is that of the modes which the solution begins in, but for x.
  void fill(const EventSolution&, const std::vector<Index>& components, bool trace, Result& result);
  /// Of the rows filled last.
  double residual(Result) const;
  /// Likewise: whether a step has another y. Not searched where M is of class P.
  OtherSolution other(const Result&, bool at_corners) const;

  Start start() const { return start_; }
  const Result& at_zero() const { return at_zero_; }  ///< status and counters of the problem at t = 0

 private:
  RowMatrix modes_of_rows() const;
  RowMatrix trace_of(const Result&) const;
  bool takes_right(const EventSolution&, Index j) const;

  DiscreteProblem p_;
  double resolution_;  ///< of the times of breakpoints
  OneSided f_, g_;
  Result at_zero_;
  Start start_;
  std::vector<Index> at_breakpoints_;  ///< rows
  RowMatrix states_;                   ///< (J+1) x m, of the rows filled last
};

}  // namespace bromwich
