#pragma once
// Rows that are linear in the values (x, f, f', g, g', g'') at one time.

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

/// A block without columns is zero.
struct Jet {
  Matrix x, f, df, g, dg, ddg;

  static Jet zero(Index rows, Index m, Index n);
};
Jet operator*(const Matrix& left, const Jet&);
Jet operator+(const Jet&, const Jet&);

/// The values of the jet at one time, or bounds of their sizes.
struct JetValues {
  Vector x, f, df, g, dg, ddg;
};

/// The jet whose blocks are a function of those of one jet, or of two.
template <class Function>
Jet of_blocks(const Function& of, const Jet& a) {
  return {of(a.x), of(a.f), of(a.df), of(a.g), of(a.dg), of(a.ddg)};
}
template <class Function>
Jet of_blocks(const Function& of, const Jet& a, const Jet& b) {
  return {of(a.x, b.x), of(a.f, b.f), of(a.df, b.df), of(a.g, b.g), of(a.dg, b.dg), of(a.ddg, b.ddg)};
}

/// The rows of one below those of the other.
Jet stacked(const Jet&, const Jet&);
Jet rows_of(const Jet&, const std::vector<Index>& rows);
Jet absolute(const Jet&);

/// Value of the rows, and the sum of the absolute values of their terms.
Vector evaluate(const Jet&, const JetValues&);
Vector terms(const Jet&, const JetValues& sizes);

}  // namespace bromwich
