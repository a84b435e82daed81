#pragma once
// Values on a face and the coefficients of its modes. With sine modes, V = S = S^T = S^-1, and with one direction of n
// points, counted from 0,
//
//     S_ki = sqrt(2/(n+1)) sin(pi (k+1)(i+1)/(n+1)),      S_{k, n-1-i} = (-1)^k S_ki,
//
// so modes k = 0, 2, ... depend on v_i + v_{n-1-i} alone, modes 1, 3, ... on v_i - v_{n-1-i}: two products of half the
// size take the place of one.

#include "../numerics/face_basis.hpp"

#include <utility>
#include <vector>

namespace bromwich {

class FaceModes {
 public:
  /// n points.
  explicit FaceModes(FaceBasis);

  /// V^T v of each row v of `values`, which has n columns, and V v.
  RowMatrix to_modes(RowMatrix values) const { return transformed(std::move(values), Way::to_modes); }
  RowMatrix to_points(RowMatrix modes) const { return transformed(std::move(modes), Way::to_points); }

  /// Sets (V modes)_i for each i of `set`; other entries may change too. `modes` and `values`: n.
  void seen_on(const std::vector<Index>& set, const Vector& modes, Vector& values) const;
  /// modes = V^T v for values v that are zero outside of `set`.
  void of_set(const std::vector<Index>& set, const Vector& values, Vector& modes) const;

 private:
  RowMatrix transformed(RowMatrix values, Way) const;
  void fold(RowMatrix& values) const;

  FaceBasis basis_;
  Index n_;
  // One direction only.
  Matrix even_, odd_;  ///< sines: S of modes 0, 2, ... and 1, 3, ..., for the first half of the points
  RowMatrix columns_;  ///< V, n x n, columns filled up to whole vectors
};

}  // namespace bromwich
