#pragma once
// Values on a face and their sine modes, S = S^T = S^-1. With one direction of n points, counted from 0,
//
//     S_ki = sqrt(2/(n+1)) sin(pi (k+1)(i+1)/(n+1)),      S_{k, n-1-i} = (-1)^k S_ki,
//
// so modes k = 0, 2, ... depend on v_i + v_{n-1-i} alone, modes 1, 3, ... on v_i - v_{n-1-i}: two products of half the
// size take the place of one.

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

class FaceModes {
 public:
  /// `extents`: points by direction; n is their product, the last direction is the fastest.
  explicit FaceModes(const std::vector<Index>& extents);

  /// S v of each row v of `values`, which has n columns. It is its own inverse.
  RowMatrix of(RowMatrix values) const;

  /// Sets (S v)_i for each i of `set`; other entries may change too. `modes` and `values`: n.
  void seen_on(const std::vector<Index>& set, const Vector& modes, Vector& values) const;
  /// modes = S v for values v that are zero outside of `set`.
  void of_set(const std::vector<Index>& set, const Vector& values, Vector& modes) const;

 private:
  std::vector<Index> extents_;
  Index n_;
  // One direction only.
  Matrix even_, odd_;  ///< S of modes 0, 2, ... and 1, 3, ..., for the first half of the points
  RowMatrix columns_;  ///< n x n, columns filled up to whole vectors
};

}  // namespace bromwich
