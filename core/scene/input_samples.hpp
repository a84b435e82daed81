#pragma once
// What an input u(t) was on the last grids. A grid that is refined keeps most of its points, and a quantity, its
// gradient and the sources of the steps look at the same ones; u may be a formula of a file or a function of Python.

#include "../base/types.hpp"

#include <map>
#include <vector>

namespace bromwich {

struct PortHamiltonian;

class InputSamples {
 public:
  /// M x k: u at the fraction s of every step of the grid t, which ends at T; at the ends of steps the limits from
  /// inside. Asks for u, in increasing time, where neither of the last two grids with this s did. u must not be empty.
  RowMatrix at(const PortHamiltonian&, double T, const Vector& t, double s);

 private:
  struct Grid {
    Vector times;
    RowMatrix u;
  };
  std::map<double, std::vector<Grid>> of_fraction_;  ///< the newest last
};

}  // namespace bromwich
