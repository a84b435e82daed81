#include "core/numerics/face_basis.hpp"

#include "core/numerics/sine_basis.hpp"

#include <algorithm>

namespace bromwich {

Matrix LineBasis::matrix() const { return V ? *V : sine_matrix(points); }

FaceBasis::FaceBasis(const std::vector<Index>& extents) {
  for (const Index n : extents) directions_.push_back({n});
}

std::vector<Index> FaceBasis::extents() const {
  std::vector<Index> extents;
  for (const LineBasis& direction : directions_) extents.push_back(direction.points);
  return extents;
}

Index FaceBasis::points() const {
  Index product = 1;
  for (const LineBasis& direction : directions_) product *= direction.points;
  return product;
}

bool FaceBasis::is_sine() const {
  return std::none_of(directions_.begin(), directions_.end(), [](const LineBasis& d) { return bool(d.V); });
}

Matrix FaceBasis::matrix() const {
  Matrix all = Matrix::Ones(1, 1);
  for (const LineBasis& direction : directions_) {
    const Index n = direction.points;
    const Matrix outer = all, inner = direction.matrix();
    all.resize(outer.rows() * n, outer.cols() * n);
    for (Index i = 0; i < outer.rows(); ++i)
      for (Index j = 0; j < outer.cols(); ++j) all.block(i * n, j * n, n, n) = outer(i, j) * inner;
  }
  return all;
}

void FaceBasis::apply(Way way, double* values) const {
  Index outer = 1, inner = points();
  for (const LineBasis& direction : directions_) {
    const Index n = direction.points;
    const Matrix V = direction.matrix();
    inner /= n;
    for (Index i = 0; i < outer; ++i) {
      Eigen::Map<RowMatrix> block(values + i * n * inner, n, inner);
      if (way == Way::to_modes)
        block = (V.transpose() * block).eval();
      else
        block = (V * block).eval();
    }
    outer *= n;
  }
}

}  // namespace bromwich
