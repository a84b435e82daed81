#include "core/lcp/blocks.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

using Pair = Eigen::Vector2d;
using Square = Eigen::Matrix2d;

constexpr double aimed_at = 1e-14;  ///< residual: rounding
constexpr double raised = 1e-8;     ///< of the diagonal in Newton's matrix, which is singular where forces are open
constexpr int most_newton = 24;     ///< iterations of an attempt
constexpr int most_halvings = 12;   ///< of a Newton step
constexpr Index first_sweeps = 4;   ///< before the first attempt; four times as many before each other one
constexpr double enough_decrease = 1e-2;  ///< of |F|, times the part of the step

// z_t(a) = (A + a I)^{-1} b with a >= 0 such that |z_t| = mu (d - c·z_t), which is too large at a = 0: where it slips,
// w_t = -a z_t.
Pair sliding(const Square& A, const Pair& b, const Pair& c, double d, double mu) {
  const Square adjoint{{A(1, 1), -A(0, 1)}, {-A(1, 0), A(0, 0)}};
  const double trace = A.trace(), determinant = A.determinant();
  const auto at = [&](double a) { return Pair((adjoint * b + a * b) / (a * a + a * trace + determinant)); };
  const auto too_large = [&](const Pair& z) { return !(z.norm() <= mu * (d - c.dot(z))); };
  double from = 0, to = A.cwiseAbs().sum();
  if (!(to > 0)) to = 1;
  for (int k = 0; k < 100 && too_large(at(to)); ++k) from = std::exchange(to, 8 * to);
  for (int k = 0; k < 200 && to - from > epsilon * to; ++k)
    (too_large(at((from + to) / 2)) ? from : to) = (from + to) / 2;
  return at(to);
}

class Problem {
 public:
  Problem(const Matrix& W, const Vector& q, const Blocks& blocks)
      : W_(W), q_(q), blocks_(blocks), unit_(Vector::Ones(q.size())), rho_(unit_) {
    for (const auto& block : blocks_) {
      Vector unit, rho;
      own_.push_back(W(block->rows(), block->rows()));
      panels_.push_back(W(block->rows(), Eigen::all));
      block->scale(own_.back(), unit, rho);
      unit_(block->rows()) = unit;
      rho_(block->rows()) = rho;
    }
  }

  // F over units.
  Vector law(const Vector& z, Matrix* slope = nullptr) const {
    const Vector w = W_ * z + q_;
    Vector F(z.size());
    Matrix by_z, by_w;
    for (std::size_t k = 0; k < blocks_.size(); ++k) {
      const auto& block = blocks_[k];
      const std::vector<Index>& rows = block->rows();
      F(rows) = block->law(z(rows), w(rows), rho_(rows), slope ? &by_z : nullptr, slope ? &by_w : nullptr);
      if (!slope) continue;
      Matrix part = by_w * panels_[k];
      part(Eigen::all, rows) += by_z + raised * by_w * rho_(rows).cwiseInverse().asDiagonal();
      (*slope)(rows, Eigen::all) = part;
    }
    if (slope) *slope = unit_.cwiseInverse().asDiagonal() * *slope * unit_.asDiagonal();
    return F.cwiseQuotient(unit_);
  }

  // Beside q: beside z a force that grows without end would solve any problem.
  double residual(const Vector& F) const {
    const double size = rho_.cwiseProduct(q_).cwiseQuotient(unit_).cwiseAbs().maxCoeff();
    return F.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / std::max(size, 1e-290);
  }

  bool sweep(Vector& z) const {
    for (std::size_t k = 0; k < blocks_.size(); ++k) {
      const std::vector<Index>& rows = blocks_[k]->rows();
      Vector next, right = panels_[k] * z;
      right += q_(rows) - own_[k] * z(rows);
      if (!blocks_[k]->solve(own_[k], right, next)) return false;
      z(rows) = next;
    }
    return z.allFinite();
  }

  Vector newton_step(const Matrix& slope, const Vector& F) const {
    const Vector step = slope.partialPivLu().solve(-F);
    return step.cwiseProduct(unit_);
  }

  Vector project(Vector z) const {
    for (const auto& block : blocks_) z(block->rows()) = block->project(z(block->rows()));
    return z;
  }

 private:
  const Matrix& W_;
  const Vector& q_;
  const Blocks& blocks_;
  std::vector<Matrix> own_, panels_;  ///< of each block: W of its rows and columns, and of its rows
  Vector unit_, rho_;
};

class Search {
 public:
  Search(const Matrix& W, const Vector& q, const Blocks& blocks) : p_(W, q, blocks), single_(blocks.size() == 1) {
    best_.z = Vector::Zero(q.size());
    best_.residual = p_.residual(p_.law(best_.z));
  }

  BlockSolution run(double tolerance, Index most_sweeps) {
    Vector z = best_.z;
    Index swept = 0;
    for (Index next = single_ ? 1 : first_sweeps; best_.residual > aimed_at; next *= 4) {
      for (Index k = 0; k < next && swept < most_sweeps && best_.residual > aimed_at; ++k, ++swept) {
        if (!p_.sweep(z)) z = best_.z;
        look(z);
      }
      if (best_.residual > aimed_at) newton(z);
      if (best_.residual <= tolerance || swept >= most_sweeps) break;
    }
    if (best_.residual > aimed_at) newton(best_.z);
    best_.sweeps = swept;
    const Vector inside = p_.project(best_.z);
    if (const double residual = p_.residual(p_.law(inside)); residual <= std::max(tolerance, best_.residual))
      best_.z = inside, best_.residual = residual;
    best_.solved = best_.residual <= tolerance;
    return std::move(best_);
  }

 private:
  void look(const Vector& z) {
    const double residual = p_.residual(p_.law(z));
    if (residual < best_.residual) best_.z = z, best_.residual = residual;
  }

  // From there; where it does not come to an end, sweeps go on from where they were.
  void newton(Vector z) {
    Matrix slope(z.size(), z.size());
    for (int k = 0; k < most_newton && best_.residual > aimed_at; ++k) {
      const Vector F = p_.law(z, &slope), step = p_.newton_step(slope, F);
      if (!step.allFinite()) return;
      ++best_.newton;
      double part = 1, best_part = 1, least = INFINITY;
      for (int halved = 0; halved < most_halvings; ++halved, part /= 2) {
        const double size = p_.law(z + part * step).norm();
        if (size < least) least = size, best_part = part;
        if (size <= (1 - enough_decrease * part) * F.norm()) break;
      }
      z += best_part * step;
      const double before = best_.residual;
      look(z);
      if (k > 0 && before < 1e-12 && best_.residual >= before / 2) return;  // rounding
    }
  }

  Problem p_;
  bool single_;
  BlockSolution best_;
};

}  // namespace

void FrictionBlock::scale(const Matrix& W, Vector& unit, Vector& rho) const {
  const double normal = W(0, 0), tangential = (W(1, 1) + W(2, 2)) / 2;
  const double of_n = normal > 0 ? 1 / normal : 1, of_t = tangential > 0 ? 1 / tangential : 1;
  rho = Vector{{of_n, of_t, of_t}};
  unit = Vector::Constant(3, std::sqrt(of_t));
}

Vector FrictionBlock::law(const Vector& z, const Vector& w, const Vector& rho, Matrix* by_z, Matrix* by_w) const {
  if (by_z) *by_z = *by_w = Matrix::Zero(3, 3);
  const double pressed = given_ ? z[0] : z[0] - rho[0] * w[0];
  const bool closed = given_ || pressed > 0;
  Vector F(3);
  F[0] = closed ? rho[0] * w[0] : z[0];
  if (by_z) (closed ? (*by_w)(0, 0) : (*by_z)(0, 0)) = closed ? rho[0] : 1;
  const Pair trial = z.tail(2) - rho[1] * w.tail(2);
  const double bound = mu_ * std::max(pressed, 0.0), size = trial.norm();
  if (size <= bound) {
    F.tail(2) = rho[1] * w.tail(2);
    if (by_z) by_w->bottomRightCorner(2, 2) = rho[1] * Matrix::Identity(2, 2);
    return F;
  }
  const Pair along = trial / size;
  F.tail(2) = z.tail(2) - bound * along;
  if (!by_z) return F;
  const Square turns = bound / size * (Square::Identity() - along * along.transpose());
  by_z->bottomRightCorner(2, 2) = Square::Identity() - turns;
  by_w->bottomRightCorner(2, 2) = rho[1] * turns;
  if (!(pressed > 0)) return F;
  by_z->block(1, 0, 2, 1) = -mu_ * along;
  if (!given_) by_w->block(1, 0, 2, 1) = mu_ * rho[0] * along;
  return F;
}

Vector FrictionBlock::project(Vector z) const {
  const double size = z.tail(2).norm();
  if (size <= mu_ * z[0]) return z;
  if (!given_) {
    if (mu_ * size <= -z[0]) return Vector::Zero(3);
    z[0] = (z[0] + mu_ * size) / (1 + mu_ * mu_);
  }
  z.tail(2) *= mu_ * std::max(z[0], 0.0) / size;
  return z;
}

bool FrictionBlock::solve(const Matrix& W, const Vector& q, Vector& z) const {
  z = Vector::Zero(3);
  if (!given_ && q[0] >= 0) return true;
  if (!(W(0, 0) > 0)) return false;
  // z_n = d - c·z_t, and A z_t = b where it sticks.
  const double d = -q[0] / W(0, 0);
  const Pair c = W.row(0).tail(2).transpose() / W(0, 0);
  const Square A = W.bottomRightCorner(2, 2) - W.col(0).tail(2) * c.transpose();
  const Pair b = -(q.tail(2) + d * W.col(0).tail(2));
  Pair t = Pair::Zero();
  if (mu_ > 0 && !b.isZero(0)) {
    t = A.inverse() * b;
    if (!(t.norm() <= mu_ * (d - c.dot(t)))) t = sliding(A, b, c, d, mu_);
  }
  z << d - c.dot(t), t;
  return z.allFinite();
}

BlockSolution solve_blocks(const Matrix& W, const Vector& q, const Blocks& blocks, double tolerance,
                           Index most_sweeps) {
  return Search(W, q, blocks).run(tolerance, most_sweeps);
}

double residual_of_blocks(const Matrix& W, const Vector& q, const Blocks& blocks, const Vector& z) {
  const Problem p(W, q, blocks);
  return p.residual(p.law(z));
}

}  // namespace bromwich
