#pragma once
// One grid line of a Kronecker sum.

#include "second_difference.hpp"

#include <vector>

namespace bromwich {

/// n^T (zI - across)^{-1} for one grid line, in closed form (the discrete Green's function of the second difference).
ComplexVector green_row(const SecondDifference& across, const Vector& n, Complex z);

/// n^T (zI - across)^{-1} b, the transfer function of one grid line, in closed form.
class LineTransfer {
 public:
  LineTransfer(const SecondDifference& across, const Vector& n, const Vector& b);
  Complex operator()(Complex z) const;

 private:
  struct Term {
    Index i, j;     ///< positions on the line, from 1
    double factor;  ///< n_i b_j
  };
  SecondDifference across_;
  std::vector<Term> terms_;
};

}  // namespace bromwich
