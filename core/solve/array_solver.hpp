#pragma once
// Solves whose sources and results are arrays of the backend, which other programs may read and write there: nothing of
// size J x n passes through the host.
//
//     y_j in SOL(M, r_j + (K * y)_j),   r = g + K phi + N e^{At} x0,   w = M y + r + K * y,
//
// by the functional iteration (core/iteration), with f = B phi.
//
// symbol  array        shape
// g, phi  g(), phi()   (J+1) x n    values at t_j = j T/J, linear in between
// y, w    y(), w()     (J+1) x n

#include "../iteration/functional_iteration.hpp"
#include "../kernel/time_operator.hpp"

#include <memory>

namespace bromwich {

class ArraySolver {
 public:
  /// f and g of the scene are not used. Of the options: steps, iteration_tolerance, max_iterations, progress,
  /// interrupted. Throws Error unless the scene has initial values and inequalities only, and where the functional
  /// iteration has no kernel for it. The backend has to outlive the solver.
  ArraySolver(Scene scene, Backend& backend, Options options);
  ~ArraySolver();
  ArraySolver(const ArraySolver&) = delete;
  ArraySolver& operator=(const ArraySolver&) = delete;

  const Scene& scene() const { return scene_; }
  Index steps() const { return problem_->J; }
  /// m values. Throws Error as Solver::set_x0.
  void set_x0(const Vector& x0);

  Array& g() { return *g_; }
  /// Made by the first call; from then on it is a part of every solve.
  Array& phi();

  /// A result without y, trace and states. Its status is `solved`, `infeasible`, `tolerance_not_met`, `nonfinite` or
  /// `interrupted`.
  Result solve();
  /// Of the last solve.
  const Array& y() const { return *y_; }
  const Array& w() const { return *w_; }

 private:
  void respond_to_x0();

  Scene scene_;
  Backend& backend_;
  Options options_;
  std::unique_ptr<DiscreteProblem> problem_;
  std::unique_ptr<TimeOperator> operator_;
  KernelPlan plan_;
  double error_of_x0_ = 0;
  std::unique_ptr<LcpBatch> lcp_;
  std::unique_ptr<Array> g_, phi_, known_, start_, r_, v_, y_, w_;
};

}  // namespace bromwich
