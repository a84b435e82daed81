#pragma once
// The interface of a method that solves a window of time points at once, for solve_nonlinear.

#include "../core/base/types.hpp"

#include <optional>
#include <string>

namespace bromwich {

class WindowsOfSteps {
 public:
  /// x or v = N x, and y at all time points of a window.
  struct Rows {
    RowMatrix seen, y;
  };
  struct Outcome {
    double contraction = 0;  ///< measured
    double change = 0;       ///< of the last iteration, relative to the largest |y| and |x|
  };
  virtual ~WindowsOfSteps() = default;

  /// Solves `length` steps from row `from` with this state there, from the guess `rows`. Nothing where the iteration
  /// does not contract or a problem is not solved (`reason`).
  virtual std::optional<Outcome> solve(Index from, Index length, const Vector& state, Rows& rows) = 0;
  /// The state at the end of the window that was solved last, with these rows.
  virtual Vector end_state(const Rows& rows) = 0;

  const std::string& reason() const { return reason_; }
  bool interrupted() const { return interrupted_; }
  bool continuous() const { return continuous_; }  ///< y is linear between the time points
  Index solves() const { return solves_; }         ///< sweeps over windows so far
  Index newton() const { return newton_; }         ///< Newton iterations so far

 protected:
  std::string reason_;
  bool interrupted_ = false, continuous_ = true;
  Index solves_ = 0, newton_ = 0;
};

/// The largest change of x or y relative to its largest value.
double apart(const WindowsOfSteps::Rows& a, const WindowsOfSteps::Rows& b);

/// Decides after each change of an iteration on a window whether it has ended.
class ContractionWatch {
 public:
  explicit ContractionWatch(double tolerance) : tolerance_(tolerance) {}

  enum class Verdict { go_on, converged, too_slow };
  Verdict after(double change);

  double contraction() const { return contraction_; }
  double last() const { return last_; }  ///< ratio of the last two changes

 private:
  double tolerance_, before_ = 0, contraction_ = 0, last_ = 0;
  Index changes_ = 0;
};

}  // namespace bromwich
