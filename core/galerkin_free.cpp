#include "core/galerkin_free.hpp"

#include "core/error.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

namespace bromwich {

namespace {

constexpr double rounding_of_free = 1e-12;  ///< relative, of D_ff and of what its null space should not see

// A B is zero up to the rounding of its terms.
bool product_vanishes(const Matrix& A, const Matrix& B) {
  if (A.rows() == 0 || B.cols() == 0) return true;
  const Matrix terms = A.cwiseAbs() * B.cwiseAbs();
  return (A * B).cwiseAbs().maxCoeff() <= rounding_of_free * terms.maxCoeff();
}

}  // namespace

FreeElimination::FreeElimination(const GalerkinProblem& p, const std::vector<Index>& free_rows) : full_(p) {
  if (free_rows.empty()) return;
  const Index n = p.unknowns() / 2;
  std::vector<char> is_free(std::size_t(2 * n), 0);
  for (const Index i : free_rows) is_free[std::size_t(i)] = is_free[std::size_t(n + i)] = 1;
  for (Index i = 0; i < 2 * n; ++i) (is_free[std::size_t(i)] ? free_ : bound_).push_back(i);

  const GalerkinStep& s = p.step;
  const Matrix D_ff = s.D(free_, free_), D_fc = s.D(free_, bound_), D_cf = s.D(bound_, free_);
  const Matrix C_f = s.C(free_, Eigen::all), H_f = s.H(Eigen::all, free_);
  const Equilibration scale = equilibrate(D_ff);  // units of unknowns and equations may differ
  Eigen::JacobiSVD<Matrix> svd(scale.rows.asDiagonal() * D_ff * scale.columns.asDiagonal(),
                               Eigen::ComputeFullU | Eigen::ComputeFullV);
  svd.setThreshold(rounding_of_free);
  unique_ = svd.rank() == D_ff.rows();
  inverse_ =
      scale.columns.asDiagonal() * svd.solve(Matrix::Identity(D_ff.rows(), D_ff.rows())) * scale.rows.asDiagonal();
  const RowMatrix q_f = p.q(Eigen::all, free_);
  if (!unique_) {
    const Index null = D_ff.rows() - svd.rank();
    const Matrix left = scale.rows.asDiagonal() * svd.matrixU().rightCols(null);      // left^T D_ff = 0
    const Matrix right = scale.columns.asDiagonal() * svd.matrixV().rightCols(null);  // D_ff right = 0
    if (!product_vanishes(left.transpose(), D_fc) || !product_vanishes(left.transpose(), C_f) ||
        !product_vanishes(D_cf, right) || !product_vanishes(H_f, right))
      throw Error("free_rows", "the equations of the free rows do not determine the free unknowns of an interval",
                  "give equations that contain them, through M or through B and N");
    const RowMatrix left_over = q_f * left;
    const double size = (q_f.cwiseAbs() * left.cwiseAbs()).maxCoeff();
    for (Index k = 0; k < p.N && !contradiction_; ++k)
      if (left_over.row(k).cwiseAbs().maxCoeff() > 1e3 * rounding_of_free * size) contradiction_ = k;
  }
  reduced_ = p;
  GalerkinStep& r = reduced_->step;
  r.E = s.E - H_f * inverse_ * C_f;
  r.H = s.H(Eigen::all, bound_) - H_f * inverse_ * D_fc;
  r.C = s.C(bound_, Eigen::all) - D_cf * inverse_ * C_f;
  r.M = s.M(bound_, bound_);
  r.D = s.D(bound_, bound_) - D_cf * inverse_ * D_fc;
  reduced_->forcing = p.forcing - q_f * (H_f * inverse_).transpose();
  reduced_->q = p.q(Eigen::all, bound_) - q_f * (D_cf * inverse_).transpose();
}

RowMatrix FreeElimination::recovered(const RowMatrix& z_c, const RowMatrix& x) const {
  if (!reduced_) return z_c;
  RowMatrix z(full_.N, full_.unknowns());
  const RowMatrix known = full_.q(Eigen::all, free_) + z_c * full_.step.D(free_, bound_).transpose() +
                          x.topRows(full_.N) * full_.step.C(free_, Eigen::all).transpose();
  const RowMatrix z_f = -known * inverse_.transpose();
  for (std::size_t i = 0; i < bound_.size(); ++i) z.col(bound_[i]) = z_c.col(Index(i));
  for (std::size_t i = 0; i < free_.size(); ++i) z.col(free_[i]) = z_f.col(Index(i));
  return z;
}

}  // namespace bromwich
