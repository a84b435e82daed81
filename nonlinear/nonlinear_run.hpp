#pragma once
// One solve of a nonlinear system on one grid: by the engine of linear scenes where phi and gamma are 0 along the
// solution, otherwise step by step or by windows of steps.

#include "bromwich/nonlinear.hpp"
#include "divided_step.hpp"
#include "nonlinear_steps.hpp"
#include "windows_of_steps.hpp"

#include <memory>
#include <string>
#include <vector>

namespace bromwich {

class NonlinearRun {
 public:
  /// `scene`: with phi and gamma of the states or the trace, as `stated` by the user. `breaks`: times at which steps
  /// are divided, in order. All of them have to outlive the run.
  NonlinearRun(const NonlinearScene& scene, const Scene& stated, const std::vector<double>& breaks, Backend&,
               const NonlinearOptions&);

  NonlinearResult run();

 private:
  RowMatrix& seen() { return scene_.of_trace ? result_.trace : result_.x; }
  bool fail(Status, const std::string& why);
  bool fail_at(Index j, const NewtonOutcome&);

  void solve_linear();
  bool linear_part_solves_it();
  bool vanishes(double t, const Vector& x, const Vector& y) const;

  void solve_dense();
  void solve_large();
  NonlinearSteps make_steps(StepRule) const;
  bool march(Index from, Index to);
  NewtonOutcome take(Index j, const std::vector<double>& breaks, Vector& x, Vector& y);
  std::vector<double> breaks_of(Index j) const;
  double before_jump(Index j, const std::vector<double>& breaks) const;

  bool by_windows();
  std::unique_ptr<WindowsOfSteps> make_windows() const;
  Index undivided(Index from) const;
  void keep(Index from, const WindowsOfSteps::Rows&);

  void set_slack(Index j, double before = 0);
  void find_defect();
  void certify();

  const NonlinearScene& scene_;
  const Scene& stated_;
  const std::vector<double>& breaks_;
  Backend& backend_;
  const NonlinearOptions& options_;
  const Index n_, J_;
  const double h_;
  NonlinearSteps* steps_ = nullptr;  ///< of dense scenes
  NonlinearScene on_table_;          ///< of others: f and g from tables of the grid
  Index counted_newton_ = 0;
  NonlinearResult result_;
};

}  // namespace bromwich
