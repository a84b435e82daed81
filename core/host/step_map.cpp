#include "core/host/step_map.hpp"

namespace bromwich {

Index step_rows(const StepMatrix& matrix) {
  return std::visit([](const auto& a) { return a.rows(); }, matrix);
}

StepMatrix StepMap::difference() const {
  if (step_rows(change) > 0) return change;
  if (const auto* dense = std::get_if<Matrix>(&S)) return Matrix(std::get<Matrix>(R) - *dense);
  return SparseMatrix(std::get<SparseMatrix>(R) - std::get<SparseMatrix>(S));
}

bool StepMap::plain_R() const {
  if (const auto* dense = std::get_if<Matrix>(&R)) return *dense == Matrix::Identity(dense->rows(), dense->cols());
  const auto& sparse = std::get<SparseMatrix>(R);
  for (Index j = 0; j < sparse.outerSize(); ++j) {
    bool diagonal = false;
    for (SparseMatrix::InnerIterator entry(sparse, j); entry; ++entry) {
      if (entry.value() != (entry.row() == j ? 1 : 0)) return false;
      diagonal = diagonal || entry.row() == j;
    }
    if (!diagonal) return false;
  }
  return true;
}

}  // namespace bromwich
