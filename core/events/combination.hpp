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
    const Entry* e = entries_.data();
    for (const Row& row : rows_) {
      LegendreValues all = sum.col(row.sum);
      for (const Entry* end = e + row.entries; e != end; ++e) all += e->factor * c.col(e->component);
      sum.col(row.sum) = all;
    }
  }
  void add(const Vector& c, Vector& sum) const {
    const Entry* e = entries_.data();
    for (const Row& row : rows_)
      for (const Entry* end = e + row.entries; e != end; ++e) sum[row.sum] += e->factor * c[e->component];
  }
  /// sum_i += Σ_j |factor_ij| size_j
  void add_terms(const Vector& size, Vector& sum) const {
    const Entry* e = entries_.data();
    for (const Row& row : rows_)
      for (const Entry* end = e + row.entries; e != end; ++e) sum[row.sum] += std::abs(e->factor) * size[e->component];
  }

 private:
  struct Row {
    Index sum, entries;
  };
  struct Entry {
    Index component;
    double factor;
  };
  std::vector<Row> rows_;       ///< those with entries
  std::vector<Entry> entries_;  ///< of one row after the other
};

/// The rows of a jet.
struct JetCombination {
  Combination x, f, df, g, dg, ddg;

  JetCombination() = default;
  explicit JetCombination(const Jet&);

  void add_terms(const JetValues& size, Vector& sum) const;
};

}  // namespace bromwich
