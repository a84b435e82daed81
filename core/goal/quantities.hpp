#pragma once
// Quantities of interest: functionals I of the trajectory, with their derivatives.

#include "../base/time_function.hpp"
#include "bromwich/goal.hpp"
#include "energy_balance.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// Values of a quantity on one grid.
struct QuantityEvaluation {
  double value = 0, rounding = 0;
  RowMatrix gradient;  ///< (M+1) x m, or empty
};

class QuantityOfInterest {
 public:
  virtual ~QuantityOfInterest() = default;
  virtual std::string name() const = 0;
  virtual double value(const Trajectory&) const = 0;
  /// dI/dx_i as row i: (M+1) x m.
  virtual RowMatrix gradient(const Trajectory&) const = 0;
  /// I of the exact solution, if it is known.
  virtual std::optional<double> exact() const { return std::nullopt; }
  /// I(x_h) - I(x) divided by the derivative at x_h in the direction x_h - x, for small errors: 1/2 for the square of
  /// an expression that vanishes for the exact solution, 1 otherwise.
  virtual double secant() const { return 1; }
  /// q such that halving a cell reduces its contribution by 2^-q, for a reconstruction of order p.
  virtual int order(int p) const { return p; }
  /// The contribution of each cell to an integral that value() has by the quadrature of the scheme, whose error is not
  /// one of x; empty: there is none.
  virtual Vector integrals(const Trajectory&) const { return {}; }
  /// Times in [0, T] where such an integrand jumps or has a kink: points of the grid.
  virtual std::vector<double> breakpoints() const { return {}; }
  /// Rounding error of value(): a few eps of its terms; 0 if not known.
  virtual double rounding(const Trajectory&) const { return 0; }
  /// All at once; the gradient if requested.
  virtual QuantityEvaluation evaluate(const Trajectory&, bool with_gradient) const;
};

}  // namespace bromwich
