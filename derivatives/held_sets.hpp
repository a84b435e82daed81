#pragma once
// Linear problems on the active sets S_j of a solution,
//
//     (M y + K y + r)_S = 0,   y = 0 outside S,
//
// by the methods of the complementarity problem itself: marched, swept or in multigrid cycles, on any backend. A
// problem whose solution has these sets is known,
//
//     ŷ = 1 on S, 0 elsewhere,   ŵ = 0 on S, W elsewhere,   r̂ = ŵ - M ŷ - K ŷ,
//
// and solutions depend linearly on r as long as their sets are the same. So r̂ + e r has the solution ŷ + e y, where e
// is so small that |e y| < 1 and |e w| < W: y follows without loss of digits, since both are of size one. That the sets
// are those of ŷ is checked in each result.
//
// A march on a backend that takes linear steps (core/seam/linear_march.hpp) needs none of this. Its step j is
// y_S = -(M + W_0)_SS^{-1} q_S, with factors that are made once for each set and serve the transposed problem, too.

#include "../core/kernel/discretise.hpp"
#include "../core/kernel/prepared_method.hpp"
#include "../core/kernel/time_operator.hpp"
#include "../core/result/method.hpp"
#include "../core/result/options.hpp"
#include "../core/seam/linear_march.hpp"
#include "set_responses.hpp"

#include <functional>
#include <memory>
#include <optional>

namespace bromwich {

using MakeOperator = std::function<std::unique_ptr<TimeOperator>(const DiscreteProblem&)>;

/// Factors of (M + W_0)_SS for the sets of all rows, of M_SS for that of row 0.
struct SetFactors {
  SetResponses responses;
  std::vector<Index> sets;  ///< J+1: those of the rows
};

class HeldSets {
 public:
  /// `scene`: dynamics and M; x0, f and g are not used. `active`: (J+1) x n, ŷ. `method`: march, contour or multigrid.
  /// `transpose_of`: the problem of which this is the transpose in reversed time, with the same sets in the rows J to 1
  /// and none in row 0. Null: of none.
  HeldSets(const Scene& scene, Backend&, RowMatrix active, Method method, GridFamily&, const MakeOperator&,
           const HeldSets* transpose_of = nullptr);
  HeldSets(const HeldSets&) = delete;
  HeldSets& operator=(const HeldSets&) = delete;

  struct Found {
    RowMatrix y, w;      ///< w = M y + K y + r
    RowMatrix driven{};  ///< K y; empty where the method leaves none
  };
  /// `r`: (J+1) x n. Throws Error if no method solves the problem.
  Found solve(const RowMatrix& r);

  const DiscreteProblem& problem() const { return problem_; }
  TimeOperator& time_operator() { return *operator_; }
  /// Those that the method applies.
  const SharedWeights& weights() const { return weights_; }
  Method method() const { return method_; }
  /// v <- K y; `y` may be `v`.
  RowMatrix apply(const RowMatrix& y);
  /// What `apply` is made of, for responses.
  const KernelPlan& kernel() const { return kernel_; }
  std::size_t bytes() const;

 private:
  void use(Method);
  bool use_linear_march();
  bool make_factors();
  Found march(const RowMatrix& r);
  double measure(double e, const RowMatrix& r);

  Scene scene_;
  DiscreteProblem problem_;
  std::unique_ptr<TimeOperator> operator_;
  Method method_;
  SharedWeights weights_;
  KernelPlan kernel_;
  std::unique_ptr<PreparedMethod> prepared_;
  std::unique_ptr<Array> u_, v_, r_;
  std::shared_ptr<const SetFactors> factors_;  ///< of a linear march, perhaps those of the transposed problem
  const bool transposes_;
  std::unique_ptr<March> march_;  ///< linear; null: prepared_ solves complementarity problems
  RowMatrix active_, offset_;     ///< ŷ, r̂
  double inactive_ = 1;           ///< W
  double gain_ = 0;               ///< size of y and w / W for an r of size one, in the last solve; 0: not known
  Found found_;                   ///< of the last run
};

}  // namespace bromwich
