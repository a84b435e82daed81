#pragma once
// Values of an input u(t) on the last grids, kept because u may be slow (a formula of a file, a function of Python). A
// refined grid keeps most of its points, and a quantity, its gradient and the sources of the steps use the same ones.

#include "../base/types.hpp"

#include <map>
#include <vector>

namespace bromwich {

struct PortHamiltonian;

class InputSamples {
 public:
  /// M x k: u at the fraction s of every step of the grid t, which ends at T; at the ends of steps the limits from
  /// inside. Evaluates u, in increasing time, at points that the last two grids with this s do not have. u must not be
  /// empty.
  RowMatrix at(const PortHamiltonian&, double T, const Vector& t, double s);

 private:
  struct Grid {
    Vector times;
    RowMatrix u;
  };
  std::map<double, std::vector<Grid>> of_fraction_;  ///< the newest last
};

}  // namespace bromwich
