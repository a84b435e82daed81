#pragma once
// Sizes of variables from the terms of their equations. A term in units of its row should have size 1:
//
//     size + u_of - u_in = 0   (decimal logarithms; u: sizes of the variables)
//
// in the sense of weighted least squares. A term below 1 has a small weight, since it hardly determines the size of a
// variable. Weights and sizes are computed alternately.

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

class SizeTerms {
 public:
  /// The variables are numbered from 0; -1: none. A size that is not finite is ignored.
  void add(double size, Index of, Index in);

  /// u of `count` variables; 0 where nothing is known. Empty if an iteration takes too long.
  Vector solve(Index count) const;

 private:
  struct Term {
    double size;
    Index of, in;
    double of_sizes(const Vector& u) const { return (of >= 0 ? u[of] : 0) - (in >= 0 ? u[in] : 0); }
  };

  Vector weighted(const Vector& weights, const Vector& start) const;

  std::vector<Term> terms_;
};

}  // namespace bromwich
