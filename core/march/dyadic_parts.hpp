#pragma once
// Steps divided into parts of few lengths, where every length costs a factorization: sparse scenes and Kronecker sums.
//
// A part begins at i h 2^-k and has the length h 2^-k. Behind a jump of f or g the state has a layer, and y follows it:
// a part that begins at the distance s behind a jump is at most s 2^-q long, in the steps after the jump too. Jumps are
// moved to a multiple of h 2^-18. Sources are looked at where they are: a part that ends at a moved jump sees them up
// to the jump itself,
//
//     part (a, a + d] of the grid  ->  (from, to] of the sources,   to - from = d up to one unit of h 2^-18.

#include "../kernel/discrete_problem.hpp"

#include <map>
#include <optional>
#include <vector>

namespace bromwich {

struct DyadicPart {
  double end = 0, length = 0;  ///< on the grid
  double from = 0, to = 0;     ///< where sources are looked at
};

class DyadicParts {
 public:
  /// `from_start`: a layer begins at t = 0 too. `compares_grids`: every grid of a few times the steps has more parts.
  DyadicParts(const DiscreteProblem&, bool from_start, bool compares_grids);

  /// The parts of a step, divided at the times `more` too, and with two of one unit at its end if `brief_at_end`. Call
  /// with increasing steps.
  std::vector<DyadicPart> of(Index step, const std::vector<double>& more, bool brief_at_end);

 private:
  /// A jump of f or g, or several within a unit.
  struct Jump {
    Index unit;            ///< of the step
    double before, after;  ///< the times from which, and up to which, sources are passed over
  };
  struct Division {
    std::vector<Jump> jumps;
    std::vector<Index> kinks;  ///< units
  };
  Division divide(const RoughStep&) const;
  void add(const std::vector<double>& ends, std::size_t first, std::size_t last, double begin, Division&) const;
  bool returns(const std::vector<double>& ends, std::size_t first, std::size_t last) const;
  bool jumps(double begin, double end, double length) const;
  void add_parts(Index step, const Jump& left, const Jump& right, const std::vector<Index>& cuts,
                 std::vector<DyadicPart>&);

  const DiscreteProblem& p_;
  std::optional<OneSided> f_, g_;
  Vector f_size_, g_size_;             ///< by component
  std::map<Index, Division> divided_;  ///< by step
  Index q_ = 0;
  Index last_;  ///< jump passed, in units from t = 0; negative: none
};

}  // namespace bromwich
