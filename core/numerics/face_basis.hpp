#pragma once
// Orthonormal bases of functions on a face: products of one basis for each of its directions.

#include "../base/types.hpp"

#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

/// From values at the points of a face to the coefficients of its modes, or back.
enum class Way { to_modes, to_points };

/// Modes of one direction: the sine vectors sqrt(2/(points+1)) sin(pi i k/(points+1)), or the columns of V.
struct LineBasis {
  Index points = 0;
  std::shared_ptr<const Matrix> V = nullptr;  ///< points x points, orthonormal; null: sine vectors

  Matrix matrix() const;
};

/// The fastest direction is the last one. Empty: no modes.
class FaceBasis {
 public:
  FaceBasis() = default;
  /// Sine vectors in all directions.
  FaceBasis(const std::vector<Index>& extents);
  FaceBasis(std::initializer_list<Index> extents) : FaceBasis(std::vector<Index>(extents)) {}
  explicit FaceBasis(std::vector<LineBasis> directions) : directions_(std::move(directions)) {}

  const std::vector<LineBasis>& directions() const { return directions_; }
  std::size_t size() const { return directions_.size(); }
  bool empty() const { return directions_.empty(); }
  std::vector<Index> extents() const;
  Index points() const;
  /// Sine vectors in all directions: V = V^T = V^{-1}.
  bool is_sine() const;
  /// V, points x points, with a mode in each column.
  Matrix matrix() const;
  /// values <- V^T values or V values: one product for each direction.
  void apply(Way, double* values) const;

 private:
  std::vector<LineBasis> directions_;
};

}  // namespace bromwich
