#pragma once
// Drawn changes of the data of a scene, as a derivative takes them and as scenes.

#include "derivatives/solution_derivative.hpp"

#include <functional>
#include <random>
#include <string>
#include <vector>

namespace bromwich::app {

class Drawing {
 public:
  Matrix matrix(Index rows, Index columns) {
    return Matrix::NullaryExpr(rows, columns, [this](Index, Index) { return uniform_(generator_); });
  }

 private:
  std::mt19937_64 generator_{7};
  std::uniform_real_distribution<double> uniform_{-1, 1};
};

struct Change {
  std::string name;
  DataChange data;
  bool linear;                         ///< y depends on it piecewise linearly
  std::function<Scene(double)> scene;  ///< with the change times a number
};

/// Changes of x0 (or b), f, g and M of the size of the data; f and g change linearly in time. `by_B`: f as phi of f = B
/// phi. The scene has to outlive them.
std::vector<Change> changes_of_any(const Scene&, const Vector& t, bool by_B, Drawing&);

/// And of the matrices of dense dynamics, and of the ends.
void add_matrices(const Scene&, Drawing&, std::vector<Change>& all);

}  // namespace bromwich::app
