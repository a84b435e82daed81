// Whether w = D z + C x + q >= 0 is possible on an interval for any z >= 0 and any x at all: if not, by Farkas' lemma,
// there is a u with
//
//     u >= 0,   D^T u <= 0,   C^T u = 0,   q^T u < 0.
//
// The residual of the least squares problem min |D z + C x - w + q|, z, w >= 0, is such a -u. It is computed without
// the cancellation of the residual, and believed only after these four have been checked.

#include "core/galerkin/solvers.hpp"
#include "core/lcp/enumeration.hpp"
#include "core/numerics/orthogonal_factor.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

namespace {

constexpr double rounding_of_q = 1e-12;  ///< of the largest q of a row over all times

Vector inverse_or_one(const Vector& largest) {
  return (largest.array() > 0).select(largest.cwiseInverse(), Vector::Ones(largest.size()));
}

class IntervalFeasibility {
 public:
  IntervalFeasibility(const GalerkinStep& step, const Vector& q_size) {
    const Index n = step.D.rows(), m = step.C.cols();
    Matrix known(n, n + m);
    known << step.D, step.C;
    rows_ = inverse_or_one(known.cwiseAbs().rowwise().maxCoeff());
    known = (rows_.asDiagonal() * known).eval();
    known = (known * inverse_or_one(known.cwiseAbs().colwise().maxCoeff().transpose()).asDiagonal()).eval();
    D_ = known.leftCols(n);
    C_ = known.rightCols(m);
    q_size_ = rows_.cwiseProduct(q_size);
    cone_.resize(n, 2 * n + 2 * m);  // z, x+, x-, w
    cone_ << D_, C_, -C_, -Matrix::Identity(n, n);
  }

  bool is_certainly_infeasible(const Vector& given) {
    const Vector q = rows_.cwiseProduct(given);
    for (std::size_t i = 0; i < bases_.size(); ++i)
      if (reaches(bases_[i], q)) {
        std::swap(bases_[i], bases_.front());
        return false;
      }
    const Vector v = nonnegative_least_squares(cone_, -q);
    Basis basis;
    for (Index j = 0; j < v.size(); ++j)
      if (v[j] > 0) basis.columns.push_back(j);
    if (basis.columns.empty()) return proves_infeasible(-q, q);
    basis.qr.compute(cone_(Eigen::all, basis.columns));
    if (reaches(basis, q)) {
      if (bases_.size() < most_bases) bases_.push_back(std::move(basis));
      return false;
    }
    return proves_infeasible(out_of_reach(basis, q), q);
  }

 private:
  static constexpr std::size_t most_bases = 64;

  // Columns of the cone whose nonnegative combinations give -q.
  struct Basis {
    std::vector<Index> columns;
    Eigen::ColPivHouseholderQR<Matrix> qr;
  };

  bool reaches(const Basis& basis, const Vector& q) const {
    constexpr double same = 1e-9;  // nothing is claimed from it
    const Vector v = basis.qr.solve(Vector(-q));
    return v.minCoeff() >= -same * v.maxCoeff() && (cone_(Eigen::all, basis.columns) * v + q).norm() <= same * q.norm();
  }

  // The part of -q orthogonal to the columns of the basis; exactly zero where one of them is a w_i.
  Vector out_of_reach(const Basis& basis, const Vector& q) const {
    const Index n = q.size();
    const Matrix rest = orthogonal_factor(basis.qr.householderQ()).rightCols(n - basis.qr.rank());
    Vector u = -rest * (rest.transpose() * q);
    for (const Index j : basis.columns)
      if (j >= cone_.cols() - n) u[j - (cone_.cols() - n)] = 0;
    return u;
  }

  bool proves_infeasible(Vector u, const Vector& q) const {
    if (!u.allFinite() || !(u.maxCoeff() > 0)) return false;
    u = (u.array() > 1e-12 * u.maxCoeff()).select(u, 0.0).eval();
    const double rounding =
        16 * double(u.size() + 4) * epsilon;  // of sums of that many terms, each rounded a few times
    const Vector D_u = D_.transpose() * u, D_terms = D_.cwiseAbs().transpose() * u;
    const Vector C_u = C_.transpose() * u, C_terms = C_.cwiseAbs().transpose() * u;
    return (D_u.array() <= rounding * D_terms.array()).all() &&
           (C_u.array().abs() <= rounding * C_terms.array()).all() && q.dot(u) < -rounding_of_q * q_size_.dot(u);
  }

  Vector rows_, q_size_;
  Matrix D_, C_, cone_;  ///< rows and columns of size 1
  std::vector<Basis> bases_;
};

// How far w is from w >= 0 on each interval, relative to the q of its row.
Vector violations(const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x, const Vector& q_size) {
  RowMatrix w = p.q;
  if (z.rows() == p.N && x.rows() == p.N + 1 && z.allFinite() && x.allFinite())
    w = galerkin_slack(p, z.cwiseMax(0.0), x);
  return (-w * inverse_or_one(q_size).asDiagonal()).rowwise().maxCoeff();
}

}  // namespace

Index first_infeasible_interval(const GalerkinProblem& p, const Options& options, const RowMatrix& z,
                                const RowMatrix& x) {
  constexpr double most_operations = 1e10;  // a least squares problem of n rows takes some n^4
  constexpr double fewest_looks = 256;
  const Vector q_size = p.q.cwiseAbs().colwise().maxCoeff().transpose();
  const Vector violation = violations(p, z, x, q_size);
  std::vector<Index> open;
  for (Index k = 0; k < p.N; ++k)
    if (!(violation[k] <= rounding_of_q)) open.push_back(k);
  const double looks = std::max(fewest_looks, most_operations / std::pow(double(p.unknowns()), 4));
  if (double(open.size()) > looks) {
    const auto last = open.begin() + std::ptrdiff_t(looks);
    std::nth_element(open.begin(), last, open.end(), [&](Index a, Index b) { return violation[a] > violation[b]; });
    open.erase(last, open.end());
    std::sort(open.begin(), open.end());
  }
  auto next = open.begin();
  for (const GalerkinRun& run : p.runs) {
    IntervalFeasibility feasibility(run.step, q_size);
    for (; next != open.end() && *next < run.first + run.count; ++next) {
      if (options.interrupted && options.interrupted()) return -1;
      if (feasibility.is_certainly_infeasible(p.q.row(*next).transpose())) return *next;
    }
  }
  return -1;
}

}  // namespace bromwich
