#include "core/galerkin/free.hpp"

#include "core/base/error.hpp"
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

  reduced_ = p;
  reduced_->q = p.q(Eigen::all, bound_);
  for (std::size_t i = 0; i < p.runs.size(); ++i) eliminate(p.runs[i], reduced_->runs[i].step);
}

void FreeElimination::eliminate(const GalerkinRun& run, GalerkinStep& r) {
  const GalerkinStep& s = run.step;
  const Matrix D_ff = s.D(free_, free_), D_fc = s.D(free_, bound_), D_cf = s.D(bound_, free_);
  const Matrix C_f = s.C(free_, Eigen::all), H_f = s.H(Eigen::all, free_);
  const Equilibration scale = equilibrate(D_ff);  // units of unknowns and equations may differ
  Eigen::JacobiSVD<Matrix> svd(scale.rows.asDiagonal() * D_ff * scale.columns.asDiagonal(),
                               Eigen::ComputeFullU | Eigen::ComputeFullV);
  svd.setThreshold(rounding_of_free);
  const bool regular = svd.rank() == D_ff.rows();
  const Matrix inverse =
      scale.columns.asDiagonal() * svd.solve(Matrix::Identity(D_ff.rows(), D_ff.rows())) * scale.rows.asDiagonal();
  const RowMatrix q_f = full_.q(Eigen::seqN(run.first, run.count), free_);
  if (!regular) {
    unique_ = false;
    const Index null = D_ff.rows() - svd.rank();
    const Matrix left = scale.rows.asDiagonal() * svd.matrixU().rightCols(null);      // left^T D_ff = 0
    const Matrix right = scale.columns.asDiagonal() * svd.matrixV().rightCols(null);  // D_ff right = 0
    if (!product_vanishes(left.transpose(), D_fc) || !product_vanishes(left.transpose(), C_f) ||
        !product_vanishes(D_cf, right) || !product_vanishes(H_f, right))
      throw Error("free_rows", "the equations of the free rows do not determine the free unknowns of an interval",
                  "give equations that contain them, through M or through B and N");
    const RowMatrix left_over = q_f * left;
    const double size = (q_f.cwiseAbs() * left.cwiseAbs()).maxCoeff();
    for (Index k = 0; k < run.count && !contradiction_; ++k)
      if (left_over.row(k).cwiseAbs().maxCoeff() > 1e3 * rounding_of_free * size) contradiction_ = run.first + k;
  }
  r.E = s.E - H_f * inverse * C_f;
  r.H = s.H(Eigen::all, bound_) - H_f * inverse * D_fc;
  r.C = s.C(bound_, Eigen::all) - D_cf * inverse * C_f;
  r.M = s.M(bound_, bound_);
  r.D = s.D(bound_, bound_) - D_cf * inverse * D_fc;
  reduced_->forcing.middleRows(run.first, run.count) -= q_f * (H_f * inverse).transpose();
  reduced_->q.middleRows(run.first, run.count) -= q_f * (D_cf * inverse).transpose();
  inverses_.push_back(inverse);
}

RowMatrix FreeElimination::bound_part(const RowMatrix& z) const {
  return reduced_ ? RowMatrix(z(Eigen::all, bound_)) : z;
}

RowMatrix FreeElimination::recovered(const RowMatrix& z_c, const RowMatrix& x) const {
  if (!reduced_) return z_c;
  RowMatrix z(full_.N, full_.unknowns());
  for (std::size_t i = 0; i < bound_.size(); ++i) z.col(bound_[i]) = z_c.col(Index(i));
  for (std::size_t i = 0; i < full_.runs.size(); ++i) {
    const GalerkinRun& run = full_.runs[i];
    const auto rows = Eigen::seqN(run.first, run.count);
    const RowMatrix known = full_.q(rows, free_) +
                            z_c.middleRows(run.first, run.count) * run.step.D(free_, bound_).transpose() +
                            x.middleRows(run.first, run.count) * run.step.C(free_, Eigen::all).transpose();
    z(rows, free_) = -known * inverses_[i].transpose();
  }
  return z;
}

}  // namespace bromwich
