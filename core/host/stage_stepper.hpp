#pragma once
// Steps of a march in stages, grouped by length. Every step solves
//
//     0 <= Y ⊥ D (I ⊗ M + W) Y + D q >= 0,   Y = (y_1, ..., y_s),   D = diag(3/4, 1/4) for two stages,
//
// with the implicit part W. The quadrature weights D make D (I ⊗ M + W) positive semidefinite for passive scenes
// (algebraic stability), so the problem stays in a class that can be solved. They do not change the solutions.

#include "stage_step.hpp"
#include "step_lcp.hpp"

#include <cmath>
#include <map>
#include <memory>
#include <vector>

namespace bromwich::host {

/// Steps of one length, with their complementarity problem.
class Stepper {
 public:
  Stepper(const StageProblem& p, Index stages, double h, const std::vector<Index>& rows)
      : step_(make_stage_step(p, stages, h, rows)),
        M_(to_dense(*p.M)),
        stages_(stages),
        length_(h),
        scale_(weights()),
        // The two-stage problem does not inherit the class of M: least elements need not exist there.
        lcp_(scale_.asDiagonal() * (blocks() + step_->implicit_part()), M_,
             stages == 1 ? p.lcp_class : LcpClass::unknown, scale_.asDiagonal() * blocks()) {}

  // Advances x_{j-1} to x_j and sets Y. `place` is the index of step j among the rows, `touching` the constraints that
  // were active at the end of the last step. If the LCP has several solutions, as with rigid contacts, the other
  // constraints stay inactive if they can. False: the LCP is unsolved.
  bool advance(const Vector& x, Index place, Index j, const std::vector<bool>& touching, Vector& next,
               MarchReport& report) {
    step_->free(x, place, q_, next);
    free_ = q_.tail(M_.rows());
    if ((q_.array() >= 0).all()) {
      Y.setZero(q_.size());
      ++report.count.solved;
      return true;
    }
    q_.array() *= scale_.array();
    if (!lcp_.well_posed()) lcp_.start_from(active_in_all_stages(touching));
    if (!lcp_.solve(q_, Y, j, report)) return false;
    step_->drive(Y, next);
    return true;
  }

  Index stages() const { return stages_; }
  double length() const { return length_; }
  const StageStep& step() const { return *step_; }
  /// s n x s n: of the problem of Y, without its weights.
  Matrix matrix() const { return blocks() + step_->implicit_part(); }
  auto first_stage() const { return Y.head(M_.rows()); }
  auto last_stage() const { return Y.tail(M_.rows()); }
  // Mean of y over the step, by the quadrature weights.
  Vector mean() const { return stages_ == 1 ? Y : Vector(0.75 * first_stage() + 0.25 * last_stage()); }

  // N x + g at the end of the step.
  Vector seen_at_end() const {
    Vector seen = free_;
    seen.noalias() += step_->implicit_part().bottomRows(M_.rows()) * Y;
    return seen;
  }
  // N x at the end of the step of y at the first of two stages alone.
  Vector seen_at_end(const Vector& y) const {
    const Index n = M_.rows();
    return step_->implicit_part().block(n, 0, n, n) * y;
  }

  // Solutions of a step are unique, or form a convex set from which one is selected.
  bool well_posed() const { return lcp_.well_posed(); }

  // Whether some constraint is active at only one of the two stages, beyond rounding.
  bool switches() const {
    const double zero = 1e-9 * Y.cwiseAbs().maxCoeff();
    for (Index i = 0; i < M_.rows() && stages_ == 2; ++i)
      if ((Y[i] > zero) != (Y[M_.rows() + i] > zero)) return true;
    return false;
  }

  std::size_t bytes() const {
    return step_->bytes() + sizeof(double) * std::size_t(M_.size() + scale_.size()) + lcp_.bytes();
  }

  Vector Y;

 private:
  Vector active_in_all_stages(const std::vector<bool>& touching) const {
    Vector y(q_.size());
    for (Index i = 0; i < y.size(); ++i) y[i] = touching[std::size_t(i % M_.rows())] ? 1 : 0;
    return y;
  }

  Vector weights() const {
    Vector d = Vector::Ones(stages_ * M_.rows());
    if (stages_ == 2) d << Vector::Constant(M_.rows(), 0.75), Vector::Constant(M_.rows(), 0.25);
    return d;
  }
  Matrix blocks() const {
    const Index n = M_.rows();
    Matrix all = Matrix::Zero(stages_ * n, stages_ * n);
    for (Index i = 0; i < stages_; ++i) all.block(i * n, i * n, n, n) = M_;
    return all;
  }

  std::unique_ptr<StageStep> step_;
  Matrix M_;
  Index stages_;
  double length_;
  Vector scale_;
  StepLcp lcp_;
  Vector q_, free_;  ///< free_: N x + g at the end of the step without y
};

/// Steps grouped by length: most have the length of the problem, some are parts of a step.
class Lengths {
 public:
  Lengths(const StageProblem& p, Index rows) : place_(std::size_t(rows)), kind_(std::size_t(rows), 0), sizes_{p.h} {
    rows_.resize(1);
    const int bits = std::min(44, 50 - std::ilogb(double(rows)));
    std::map<long long, std::size_t> kinds{{key(1, bits), 0}};
    for (Index j = 0; j < rows; ++j) {
      const double d = j == 0 || p.lengths.empty() ? p.h : p.lengths[std::size_t(j) - 1];
      const auto [found, added] = kinds.try_emplace(key(d / p.h, bits), sizes_.size());
      if (added) {
        sizes_.push_back(d);
        rows_.emplace_back();
      }
      kind_[std::size_t(j)] = found->second;
      place_[std::size_t(j)] = Index(rows_[found->second].size());
      rows_[found->second].push_back(j);
    }
  }

  std::size_t kind(Index j) const { return kind_[std::size_t(j)]; }
  Index place(Index j) const { return place_[std::size_t(j)]; }  ///< index among the rows of its kind
  std::size_t kinds() const { return sizes_.size(); }
  double size(std::size_t kind) const { return sizes_[kind]; }
  const std::vector<Index>& rows(std::size_t kind) const { return rows_[kind]; }

 private:
  // Lengths that agree to 2^-44 count as equal, and those that differ by the rounding of the times of their ends: that
  // is 2^-53 of T, about, and h is a share 1 / rows of T.
  static long long key(double part, int bits) {
    int exponent = 0;
    const double digits = std::frexp(part, &exponent);
    return (std::llround(std::ldexp(digits, bits)) << 11) + exponent;
  }

  std::vector<Index> place_;
  std::vector<std::size_t> kind_;
  std::vector<double> sizes_;
  std::vector<std::vector<Index>> rows_;
};

}  // namespace bromwich::host
