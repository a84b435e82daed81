#pragma once
// Parts of the study that repeats section 4 of Wu and Chen, A parallel iterative algorithm for differential linear
// complementarity problems (SIAM J. Sci. Comput. 39, 2017). Each part appends rows, with "figure" the number of the
// paper's figure, and notes computed from them.

#include "bench/studies/study.hpp"

#include <functional>
#include <map>

namespace bromwich::app {

inline constexpr double horizon = 4;  ///< T of the second example

/// Fig. 4.1: the k-th iterate of dlcp-small, compared with Theorem 2.2.
void paper_small_iterates(bool quick, Backend&, BenchReport&);
/// Fig. 4.6: the k-th iterate of signorini for several h and dx.
void paper_large_iterates(bool quick, Backend&, BenchReport&);
/// Fig. 4.3: error over the step and over the nodes of a contour.
void paper_step_errors(bool quick, Backend&, BenchReport&);
void paper_node_errors(bool quick, Backend&, BenchReport&);
/// Fig. 4.4: steps at which the matrix of implicit Euler is not a Z-matrix.
void paper_robustness(bool quick, Backend&, BenchReport&);
/// Fig. 4.10 and Table 4.1: time.
void paper_times(bool quick, int repeats, Backend&, BenchReport&);

/// Largest entry of |a - b|; NaN if either has one or the shapes differ.
double largest_difference(const RowMatrix& a, const RowMatrix& b);

/// dlcp-small with y4 = (cos 3 pi t)+ / 4 and w4 = (cos 3 pi t)-, as examples/dlcp-small-unstable.toml: the state with
/// the constraints 2 and 4 active grows like e^{118 t}.
Scene unstable_dlcp_small(double T);

/// Errors of the iterates k = 1, 2, ... of `contour` relative to the converged one, solved on demand.
class Iterates {
 public:
  struct Error {
    double y = 0, trace = 0, x = 0;  ///< largest over all times; x is NaN if the state was not requested
  };
  Iterates(const Scene&, Backend&, Index steps, bool with_states);

  const Error& error(Index k);
  /// Largest deviation of the start x^0(t) = x0 from the converged solution, in the Euclidean norm and largest over all
  /// times; NaN without states.
  double start_error() const;
  /// The smallest k from which `of` stays below the tolerance, by bisection; assumes decay from there.
  Index sweeps_to(double tolerance, const std::function<double(const Error&)>& of);
  double h() const { return scene_.T / double(steps_); }

 private:
  Options options(Index k) const;

  const Scene& scene_;
  Backend& backend_;
  Index steps_;
  bool with_states_;
  Result converged_;
  std::map<Index, Error> errors_;
};

/// Theorem 2.2 (1): sup |x^k - x*| <= C^k Θ_1 ... Θ_k / k! sup |x^0 - x*|, all norms Euclidean, constants computed.
struct IterationBound {
  double phi;                   ///< of (2.1b), at the nodes of the contours of the time grid
  double lipschitz;             ///< L of Lemma 3.1, over all nonsingular M_SS
  double factor;                ///< phi L |B| |N| T
  std::vector<double> decades;  ///< log10 of the bound relative to the start, for k = 0, 1, ...

  /// The smallest k > 0 for which the bound is below the error of the start; -1 beyond its length.
  Index useful_from() const;
};
/// For at least `least` sweeps, continued until the bound is below 1.
IterationBound iteration_bound(const Scene& scene, Index nodes, Index steps, Index least);

}  // namespace bromwich::app
