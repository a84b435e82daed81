#pragma once
// (5.2): a nonlinear system on windows of time by linear scenes, whose sources hold phi and gamma of the last iterate,
//
//     x' = A x + B y + f + phi(x^k, y^k),   0 <= y  ⊥  w = N x + M y + g + gamma(x^k, y^k) >= 0,
//
// both linear between the time points. With linearizations about an outer iterate the fixed point is that of one Newton
// iteration of the window. The linear scene is prepared once for all windows of a length (Solver).

#include "../core/solve/solver.hpp"
#include "bromwich/nonlinear.hpp"
#include "nonlinear_scene.hpp"
#include "windows_of_steps.hpp"

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich {

/// The linear part, with phi and gamma added to its sources. They are given by rows, h apart and linear in between. phi
/// has m values, or, with `of_trace`, n values that enter through B; without rows it is 0.
Scene with_rest(const Scene& linear, bool of_trace, RowMatrix phi, RowMatrix gamma, double h);

class FrozenWindows final : public WindowsOfSteps {
 public:
  /// The scene and the options have to outlive it. J steps of length h in all. Method iteration or newton.
  FrozenWindows(const NonlinearScene&, Backend&, const NonlinearOptions&, NonlinearMethod, Index J);

  std::optional<Outcome> solve(Index from, Index length, const Vector& state, Rows& rows) override;
  Vector end_state(const Rows& rows) override;

 private:
  /// phi and gamma about the rows of the last Newton iterate: kept for all time points, or, where that would take more
  /// than `most_kept` bytes, made again whenever they are used.
  struct Linearizations {
    Rows about;
    std::vector<std::array<Linearization, 2>> kept;
  };

  std::optional<Outcome> iterate(const Linearizations*, double tolerance, Rows& rows);
  std::optional<Outcome> newton(Rows& rows);
  bool sweep(RowMatrix phi, RowMatrix gamma, Rows& rows);
  std::array<Linearization, 2> linearize_at(Index row, const Rows& about) const;
  void rest_at(Index j, const Linearizations*, const Rows& rows, RowMatrix& phi, RowMatrix& gamma) const;
  void rest(const Linearizations*, const Rows& rows, RowMatrix& phi, RowMatrix& gamma) const;
  void each_row(Index count, const std::function<void(Index)>& use) const;
  double time(Index row) const { return double(from_ + row) * h_; }

  static constexpr double most_kept = 1e9;

  const NonlinearScene& scene_;
  Backend& backend_;
  const NonlinearOptions& options_;
  NonlinearMethod method_;
  double h_;
  Scene window_;  ///< the linear part of the window
  Index from_ = 0, length_ = 0;
  std::unique_ptr<Solver> solver_;  ///< of windows of `length_` steps
  Result last_;                     ///< of the last linear solve, without the rows
};

}  // namespace bromwich
