#pragma once
// Sizes of variables from the terms of their equations. A term in units of its row should have size 1:
//
//     size + u_of - u_in = 0   (decimal logarithms; u: sizes of the variables)
//
// in the sense of weighted least squares. A term below 1 has a small weight, since it hardly determines the size of a
// variable. Weights and sizes are computed alternately.
//
// Where two variables enter each other's equations, other sizes change the two terms of the pair alike, one up and the
// other down. Sizes that make one term of each pair 1 and let the other vanish may look best then: an inverse mass
// matrix has such pairs for all states, with entries that decay from state to state, and its states would differ by ten
// decades and more. Where sizes of variables that strong pairs join are that far from balancing the pairs, they are
// made to balance them, up to a common factor.

#include "../base/types.hpp"

#include <cmath>
#include <vector>

namespace bromwich {

class SizeTerms {
 public:
  /// The variables are numbered from 0; -1: none. A size that is not finite is ignored.
  void add(double size, Index of, Index in);
  /// One of the two terms in which `of` and `in` enter each other's equations; `mean` is that of their sizes.
  void add_of_pair(double size, double mean, Index of, Index in);

  /// u of `count` variables; 0 where nothing is known. Empty if an iteration takes too long.
  Vector solve(Index count) const;

 private:
  struct Term {
    double size;
    Index of, in;
    double mean = NAN;  ///< of a pair
    double of_sizes(const Vector& u) const { return (of >= 0 ? u[of] : 0) - (in >= 0 ? u[in] : 0); }
  };

  /// Variables with known ratios of their sizes.
  struct Groups {
    std::vector<Index> of;  ///< of each variable
    Vector shape;           ///< of each variable: its size in a group of size 0
    Index count = 0;
  };

  Groups joined(Index count) const;
  static Groups unbalanced(const Groups&, const Vector& u);
  std::vector<Term> between(const Groups&) const;

  std::vector<Term> terms_;
};

}  // namespace bromwich
