#pragma once
// (5.2): a nonlinear system on windows of time by linear scenes, whose sources hold phi and gamma of the last iterate,
//
//     x' = A x + B y + f + phi(x^k, y^k),   0 <= y  ⊥  w = N x + M y + g + gamma(x^k, y^k) >= 0,
//
// both linear between the time points. With linearizations about an outer iterate the fixed point is that of one Newton
// iteration of the window. The linear scene is prepared once for all windows of a length (Solver).

#include "../solve/solver.hpp"
#include "nonlinear_options.hpp"
#include "nonlinear_scene.hpp"

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// The linear part with rows of phi and gamma, h apart and linear between, added to its sources. phi has m values, or n
/// that enter through B with `of_trace`.
Scene with_rest(const Scene& linear, bool of_trace, RowMatrix phi, RowMatrix gamma, double h);

class FrozenWindows {
 public:
  /// x or v = N x, and y at all time points of a window.
  struct Rows {
    RowMatrix seen, y;
  };
  struct Outcome {
    double contraction = 0;  ///< measured
    double change = 0;       ///< of the last linear solve, relative to the largest |y| and |x|
  };

  /// The scene and the options have to outlive it. J steps of length h in all.
  FrozenWindows(const NonlinearScene&, Backend&, const NonlinearOptions&, NonlinearMethod, Index J);

  /// Solves `length` steps from row `from` with this state there, from the guess `rows`. Nothing where the iteration
  /// does not contract or a linear scene is not solved (`reason`).
  std::optional<Outcome> solve(Index from, Index length, const Vector& state, Rows& rows);
  /// The state at the end of the window that was solved last.
  Vector end_state() const;

  const std::string& reason() const { return reason_; }
  bool interrupted() const { return interrupted_; }
  bool continuous() const { return continuous_; }  ///< y of the linear scenes is linear between the time points
  Index solves() const { return solves_; }         ///< linear solves so far
  Index newton() const { return newton_; }         ///< Newton iterations so far

 private:
  using Linearizations = std::vector<std::array<Linearization, 2>>;  ///< of phi and gamma at all time points

  std::optional<Outcome> iterate(const Rows& about, const Linearizations* at, double tolerance, Rows& rows);
  std::optional<Outcome> newton(Rows& rows);
  bool sweep(RowMatrix phi, RowMatrix gamma, Rows& rows);
  void rest(const Rows& about, const Linearizations* at, const Rows& rows, RowMatrix& phi, RowMatrix& gamma) const;
  double time(Index row) const { return double(from_ + row) * h_; }

  const NonlinearScene& scene_;
  Backend& backend_;
  const NonlinearOptions& options_;
  NonlinearMethod method_;
  double h_;
  Scene window_;  ///< the linear part of the window
  Index from_ = 0, length_ = 0;
  std::unique_ptr<Solver> solver_;  ///< of windows of `length_` steps
  Result last_;                     ///< of the last linear solve
  std::string reason_;
  bool interrupted_ = false, continuous_ = true;
  Index solves_ = 0, newton_ = 0;
};

}  // namespace bromwich
