#pragma once
// The functional iteration with nonlinear complementarity problems, on windows of time: a sweep solves those of all
// time points at once, with the states of the last one,
//
//     0 <= y_j  ⊥  N x_j^k + M y_j + g_j + gamma(t_j, x_j^k, y_j) >= 0   for all j (nonlinear/ncp_batch.hpp)
//     x_j^{k+1} = e^{hA} x_{j-1}^{k+1} + s_j + L F_{j-1} + W F_j,   F_j = B y_j + phi(t_j, x_j^k, y_j),
//
// as (2.17) of the Laplace-inversion paper does where gamma = 0. It contracts by the change of y with x, times K. A
// gamma that is steep in y does not matter here, but it does where gamma is frozen.

#include "../core/base/threads.hpp"
#include "bromwich/nonlinear.hpp"
#include "nonlinear_steps.hpp"
#include "windows_of_steps.hpp"

namespace bromwich {

class PointwiseWindows final : public WindowsOfSteps {
 public:
  /// The scene, its steps (rule linear) and the options have to outlive it. Dense dynamics.
  PointwiseWindows(const NonlinearScene&, const NonlinearSteps&, const HostThreads&, const NonlinearOptions&);

  std::optional<Outcome> solve(Index from, Index length, const Vector& state, Rows& rows) override;
  Vector end_state(const Rows&) override { return end_; }

 private:
  bool solve_points(Index from, const Rows& about, RowMatrix& y);
  RowMatrix states(Index from, const Vector& state, const RowMatrix& about, const RowMatrix& y) const;

  const NonlinearScene& scene_;
  const NonlinearSteps& steps_;
  const HostThreads& threads_;
  const NonlinearOptions& options_;
  Vector end_;
};

}  // namespace bromwich
