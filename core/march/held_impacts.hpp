#pragma once
// Whole steps of ImpactSteps on which nothing changes: closed contacts keep their forces, open ones stay open, sliding
// goes on in its direction, and the rows S of the problem of velocities that have had forces on the step before have
// them again. All that a step does is linear then in x and in the coefficients of the sources,
//
//     v = e^{hA} x + drive,   z_S = -W_SS^{-1} q_S,   x+ = v + D y,   D = ∫_0^h e^{sA} B ds,
//
// with matrices that are made once. What could change is looked at on bounds that are safe; where it may, the step is
// left to ImpactSteps.

#include "impact_flow.hpp"
#include "impact_rows.hpp"
#include "smooth_sources.hpp"

#include <vector>

namespace bromwich {

class HeldImpacts {
 public:
  /// The rows have to outlive this object.
  HeldImpacts(const ImpactRows&, const ImpactFlow&, double h);

  /// Whether its matrices pay: few states, and no friction on circles.
  static bool serves(const ImpactRows&);

  /// From now on these contacts are closed, these rows are in the problem with matrix W, and those with y > 0 have
  /// forces. `back`: what puts positions back onto the gaps `held`, m x held. Then is_held(closed, y) is true, unless
  /// the rows do not determine a step.
  void hold(const std::vector<char>& closed, const std::vector<Index>& rows, const Matrix& W, const Vector& y,
            const std::vector<Index>& held, const Matrix& back);
  bool is_held(const std::vector<char>& closed, const Vector& y) const;

  /// A step over these sources, of length h, from x. False, with nothing changed: something may change on it. y: at its
  /// end. `integral`: gets what it adds. `residual`: the largest so far, of the problem of the step, relative.
  bool step(const SmoothSources&, Vector& x, Vector& y, Vector& integral, double& residual);

 private:
  /// What is solved with the rows of friction that are no forces: the speed that a row needs.
  struct Slip {
    Index room;
    std::vector<Index> speeds;
    std::vector<double> by;
    bool given;  ///< its bound is given
    bool acts;   ///< it is in the problem
  };
  void set_sources(const SmoothSources&);
  bool solve(const SmoothSources&, double& residual);
  bool stays(double largest_x, const SmoothSources&) const;
  double slip_of(const Slip&, const Vector& w) const;

  const ImpactRows& rows_;
  const double h_;
  const Index m_, n_;
  Matrix decay_, drive_, forced_;  ///< of x at the end: m x m by x, m x 3m by the columns of f, m x n by y of forces
  SparseMatrix N_, NA_, NB_;
  Vector size_of_N_;
  std::vector<Slip> slips_;

  bool holds_ = false;
  std::vector<char> closed_;
  std::vector<Index> in_problem_, active_;  ///< rows; positions in the problem with forces
  std::vector<char> is_active_;             ///< of in_problem_
  std::vector<Index> gaps_;                 ///< that are open
  Matrix W_, inverse_, back_;
  Vector size_of_W_;
  std::vector<Index> held_;

  // Of a step: values and rates of w at both ends without M y, their parts by f and g, and the rest.
  Vector x_, end_, slope_, begin_, slope_at_begin_, f_, g_end_, rate_end_;
  Vector q_, of_active_, z_, w_, y_, off_;
};

}  // namespace bromwich
