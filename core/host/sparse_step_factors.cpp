#include "core/host/sparse_step_factors.hpp"

#include <cmath>

namespace bromwich {

SparseStepFactors::SparseStepFactors(const StepMap& map)
    : R(std::get<SparseMatrix>(map.R)), change(std::get<SparseMatrix>(map.difference())) {
  SparseMatrix S = std::get<SparseMatrix>(map.S);
  S.makeCompressed();
  R.makeCompressed();
  change.makeCompressed();
  lu.compute(S);
  singular = lu.info() != Eigen::Success;
  if (singular) return;
  // S is singular to rounding if S^{-1} S v is far from v, even though no pivot vanished.
  const Vector v = Vector::NullaryExpr(S.rows(), [](Index i) { return 1 + std::sin(double(i * i)); });
  const Vector found = lu.solve(Vector(S * v));
  singular = !((found - v).cwiseAbs().maxCoeff() <= 1e-2);
}

}  // namespace bromwich
