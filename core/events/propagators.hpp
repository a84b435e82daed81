#pragma once
// What steps of collocation do, kept for modes and lengths that recur.

#include "collocation.hpp"
#include "mode.hpp"

#include <Eigen/LU>

#include <map>
#include <utility>
#include <vector>

namespace bromwich {

class Propagators {
 public:
  Propagators(const SystemMatrices&, double longest);

  /// The longest of `longest`, 3/4, 1/2, 3/8, 1/4, ... of it that is no longer than the length.
  double grid_length(double length) const;

  /// Z on [0, h] with Z(0) = 0 and Z' = A_S Z + input, m values. Returns the polynomials that the collocation has
  /// found, until the next call. Where the input is a line, which is changed then, these are of a length of the grid
  /// and may reach beyond h: lengths from events to breakpoints do not recur.
  const LegendreCoefficients& move(const SwitchedMode&, double h, LegendreCoefficients& input, LegendreCoefficients& z,
                                   double& work);

 private:
  /// The collocation of steps of one length in one mode.
  struct Propagator {
    std::vector<Eigen::PartialPivLU<ComplexMatrix>> factors;  ///< of I - z A_S for z = h lambda, without the positions
    Matrix by_positions;                                      ///< the rates of the others by positions
    Index used = 0;
    std::vector<Matrix> columns;  ///< Z, (s+1) m values, by coefficient k of the input
  };

  double grid_length_above(double length) const;
  Propagator& propagator(const SwitchedMode&, double h, double& work);
  ComplexVector solve(const Propagator&, Complex z, std::size_t eigenvalue, const ComplexVector& right) const;
  void collocate(const SwitchedMode&, double h, const Propagator&, const LegendreCoefficients& input,
                 LegendreCoefficients& z) const;
  void propagate(const SwitchedMode&, double h, const LegendreCoefficients& input, Index degrees,
                 LegendreCoefficients& z, double& work);

  double longest_;
  /// Positions: y does not act on their rates, nor do they depend on each other. They are eliminated.
  std::vector<Index> positions_, others_;
  Matrix by_others_;  ///< the rates of positions by the others
  std::map<std::pair<const SwitchedMode*, double>, Propagator> propagators_;
  std::size_t kept_ = 0;  ///< numbers in the factors
  LegendreCoefficients whole_;
};

}  // namespace bromwich
