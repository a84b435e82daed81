#pragma once
// Values on a face and the coefficients of its modes. With sine modes, V = S = S^T = S^-1, and with one direction of n
// points, counted from 0,
//
//     S_ki = sqrt(2/(n+1)) sin(pi (k+1)(i+1)/(n+1)),      S_{k, n-1-i} = (-1)^k S_ki,
//
// so modes k = 0, 2, ... depend on v_i + v_{n-1-i} alone, modes 1, 3, ... on v_i - v_{n-1-i}: two products of half the
// size take the place of one.

#include "../core/numerics/face_basis.hpp"

#include <utility>
#include <vector>

namespace bromwich {

class FaceModes {
 public:
  /// n points.
  explicit FaceModes(FaceBasis);

  /// n, filled up to whole vectors.
  Index width() const { return width_; }

  /// V^T v or V v in place of each row v, of n entries.
  void transform(Way, Eigen::Ref<RowMatrix> rows) const;
  RowMatrix to_modes(RowMatrix values) const { return transformed(Way::to_modes, std::move(values)); }
  RowMatrix to_points(RowMatrix modes) const { return transformed(Way::to_points, std::move(modes)); }

  /// Sets (V modes)_i for each i of `set`; other entries may change too. `values`: n. `modes`: `width`, with zeros
  /// behind n.
  void seen_on(const std::vector<Index>& set, const double* modes, Vector& values) const;
  /// modes = V^T v for values v that are zero outside of `set`.
  void of_set(const std::vector<Index>& set, const Vector& values, double* modes) const;

 private:
  RowMatrix transformed(Way way, RowMatrix values) const {
    transform(way, values);
    return values;
  }
  void fold(Eigen::Ref<RowMatrix> values) const;

  FaceBasis basis_;
  Index n_, width_;
  // One direction only.
  Matrix even_, odd_;  ///< sines: S of modes 0, 2, ... and 1, 3, ..., for the first half of the points
  RowMatrix columns_;  ///< V, n x n, columns filled up to `width`
};

}  // namespace bromwich
