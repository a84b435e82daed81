#pragma once
// Steps of dense scenes with continuous y. Those on which sources are rough (core/scene/source_steps.hpp) are divided
// into parts. On a part of length d, with y linear and f piecewise polynomial,
//
//     x(t + d) = e^{dA} x + ∫_0^d e^{(d-s)A} (B y + f) ds,    0 <= y(t + d) ⊥ N x(t + d) + M y(t + d) + g >= 0,
//
// and after a jump of g, y starts anew from SOL(M, N x + g(t+)). A whole step is one part; with E, L, R of the step,
//
//     z = E x + L y,   q = N (z + f_j) + g_j,   y+ in SOL(M + N R, q),   x+ = z + f_j + R y+.
//
// With its active set held, y+ = Z_S q, so that z+ = E x+ + L y+ = (E + (E R + L) Z_S N) z changes by one matrix over a
// run of steps with one set (core/scan/held_products.hpp).

#include "../host/step_lcp.hpp"
#include "../kernel/discrete_problem.hpp"
#include "../numerics/step_propagator.hpp"
#include "../scan/held_products.hpp"

#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich {

/// What all steps of a problem have in common. Only read once it is made.
struct SplitRule {
  explicit SplitRule(const DiscreteProblem&);

  /// The solution of a step is unique, or one is selected.
  bool well_posed() const { return selects_least(p.lcp_class) || has_convex_solutions(whole_class); }

  const DiscreteProblem& p;
  const DenseDynamics& d;
  const Index n;
  const std::shared_ptr<const StepOperators> step;
  const Matrix M, driven, driven_left;  ///< R B and L B
  const Matrix whole;                   ///< M + N R B
  const LcpClass whole_class;
  RowMatrix g;        ///< (J+1) x n
  RowMatrix forcing;  ///< (J+1) x m: of f to x_j on steps where it is linear; empty without f
  Matrix F;           ///< of the pieces of f
  double g_scale = 1;
  struct Limits {
    std::vector<Vector> after, before;  ///< of g at the begin and at the end of each part
  };
  std::map<Index, Limits> limits;  ///< by rough step; empty without g
};

class SplitSteps {
 public:
  /// The rule must outlive the steps.
  explicit SplitSteps(const SplitRule&);

  /// At row j. `with_derivative`: of (x, y) behind all steps from there, by (x, y) before them.
  void start(Index j, const Vector& x, const Vector& y, bool with_derivative);
  /// Step j, the next one. False: unsolved; the report says why.
  bool take(Index j, MarchReport&);
  /// The last step was divided into parts.
  bool in_parts() const { return in_parts_; }

  const Vector& x() const { return x_; }
  const Vector& y() const { return y_; }
  const Vector& impulse() const { return impulse_; }  ///< the integral of y over the last step
  /// What x behind the last step, in parts, has beyond that of a whole one.
  Vector defect() const { return x_ - smooth_ - rule_.driven * y_; }

  Matrix derivative();   ///< (m + n) x (m + n)
  std::uint64_t sets();  ///< a hash of all active sets

 private:
  // Operators for the effect of y at the end of a part.
  struct Part {
    Matrix driven;          ///< m x n: contribution to x of y rising linearly from 0
    Matrix matrix;          ///< M + N driven
    Matrix decay, falling;  ///< m x m and m x n: of x, and of y falling linearly to 0; empty until they are needed
    std::optional<ActiveSetLcp> lcp;
  };
  bool take_whole(Index j, MarchReport&);
  bool take_parts(const RoughStep&, MarchReport&);
  bool restart(const Vector& before, const Vector& after, Index j, MarchReport&);
  void drift(const RoughStep&, std::size_t& piece, double from, double to);
  Part& part_of(double d);
  bool solve(ActiveSetLcp&, const Vector& q, Vector& y, Index j, MarchReport&);

  void follow_whole();
  void follow_part(double d, Part&);
  void follow_restart();
  void end_run();

  const SplitRule& rule_;
  const Matrix* least_of_;
  StepPropagator propagator_;
  ActiveSetLcp lcp_, alone_;
  std::map<long long, Part> parts_;
  Vector x_, y_, smooth_, q_, impulse_;
  static constexpr Index timed_every = 8;  ///< to read the clock takes as long as a small problem
  Index solved_ = 0;
  Timer timer_;
  std::size_t next_rough_ = 0;
  bool in_parts_ = false, derives_ = false;
  Matrix dx_, dy_;     ///< m and n rows, m + n columns: behind the last step in parts
  HeldProduct run_;    ///< of z, over the whole steps since then but the last
  bool runs_ = false;  ///< there are such steps
  Vector last_;        ///< y of the last one
  SetKey key_;
  std::uint64_t hash_ = 0;
};

}  // namespace bromwich
