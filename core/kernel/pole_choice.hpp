#pragma once
// Where H(z) is computed, and which poles are taken: the first half of pole_fit.hpp, which has the method.
//
// symbol          variable            shape
// z_i             nodes: fitted, watched (the number of poles is chosen with them), held out (the error of the result)
// weighted H      Samples::of_y       2 nodes x (outputs n)      real parts, then imaginary parts; a row is one matrix
//                 Samples::others     2 nodes x (outputs (k + 1))
// s_k             poles               K, the slowest first

#include "discrete_problem.hpp"
#include "wide_system.hpp"

#include <cmath>
#include <vector>

namespace bromwich::pole_fitting {

/// Further nodes than those of the fit: some choose the number of poles, others measure the error of the result.
inline constexpr Index watched = 3, held_out = 6;

using Nodes = std::vector<Complex>;

struct FitNodes {
  Nodes nodes;
  Index fitted = 0;
  Vector weight;

  FitNodes(double h, double T);
  Index count() const { return weight.size(); }
};

/// Columns: (|s| + 1/T)/(z - s) for all poles, then 1; real and imaginary parts of nodes first .. first + count - 1.
Matrix cauchy(const FitNodes&, Index first, Index count, const Vector& poles, double unit);

/// Least squares with some of the columns, for many right-hand sides.
class LeastSquares {
 public:
  explicit LeastSquares(const Matrix& columns);
  Matrix solve(const Eigen::Ref<const RowMatrix>& data) const;

 private:
  Vector norms_;
  Matrix Qt_, R_;
};

/// H at all nodes, with weights, each block divided by its largest weighted value.
struct Samples {
  Index n = 0, outputs = 0, width = 0;  ///< width: columns of F and x0
  struct At {
    RowMatrix of_y, others;
  };
  At fitted, watched, held_out;
  Matrix scale;  ///< 2 (constraints, components) x (1 + width)

  double scale_of(Index output, Index column) const { return scale(output < n ? 0 : 1, column); }
  bool finite() const {
    for (const At* at : {&fitted, &watched, &held_out})
      if (!at->of_y.allFinite() || !at->others.allFinite()) return false;
    return true;
  }
};

Samples sample(const DiscreteProblem&, const Wide&, const FitNodes&);

/// Poles, the slowest first: as few as meet the tolerance for the probes, at the nodes of the fit and those watched.
/// The nodes held out have no part in the choice.
struct Picked {
  Vector poles;
  double error = INFINITY;
};

Picked pick_poles(const Samples&, const FitNodes&, double h, double T, Index most_poles);

}  // namespace bromwich::pole_fitting
