#pragma once
// Shared by the generators of random scenes.

#include "core/base/types.hpp"
#include "tests/support/random_scenes.hpp"

#include <cstdint>
#include <random>

namespace bromwich::oracle {

class Draw {
 public:
  explicit Draw(std::uint32_t seed) : engine_(seed) {}
  double uniform(double a, double b) { return a + (b - a) * double(engine_()) / 4294967296.0; }
  Index index(Index first, Index last) { return first + Index(engine_() % std::uint32_t(last - first + 1)); }
  bool chance(double p) { return uniform(0, 1) < p; }
  Matrix matrix(Index rows, Index cols) {
    return Matrix::NullaryExpr(rows, cols, [&] { return uniform(-1, 1); });
  }
  Vector vector(Index n) { return matrix(n, 1); }
  Vector positive(Index n, double a, double b) {
    return Vector::NullaryExpr(n, [&] { return uniform(a, b); });
  }

 private:
  std::mt19937 engine_;
};

/// Random n x n matrix of a family.
Matrix complementarity_matrix(Draw&, Family, Index n);
/// Random m x m matrix with a spectrum.
Matrix state_matrix(Draw&, Spectrum, Index m);

}  // namespace bromwich::oracle
