#pragma once
// Sums of the components of polynomials with constant factors, most of which are zero in the modes of a circuit. A
// component is a column of fixed length: nothing is allocated.

#include "../numerics/legendre.hpp"
#include "jet.hpp"

#include <vector>

namespace bromwich {

class Combination {
 public:
  Combination() = default;
  /// factors: sums x components.
  explicit Combination(const Matrix& factors);

  /// sum_i += Σ_j factor_ij c_j
  void add(const LegendreCoefficients& c, LegendreCoefficients& sum) const {
    for (const Entry& e : entries_) sum.col(e.sum) += e.factor * c.col(e.component);
  }
  void add(const Vector& c, Vector& sum) const {
    for (const Entry& e : entries_) sum[e.sum] += e.factor * c[e.component];
  }
  /// sum_i += Σ_j |factor_ij| size_j
  void add_terms(const Vector& size, Vector& sum) const {
    for (const Entry& e : entries_) sum[e.sum] += std::abs(e.factor) * size[e.component];
  }

 private:
  struct Entry {
    Index sum, component;
    double factor;
  };
  std::vector<Entry> entries_;  ///< in order of the sums
};

/// The rows of a jet.
struct JetCombination {
  Combination x, f, df, g, dg, ddg;

  JetCombination() = default;
  explicit JetCombination(const Jet&);

  void add_terms(const JetValues& size, Vector& sum) const;
};

}  // namespace bromwich
