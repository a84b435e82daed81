#include "core/lcp/enumeration.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

// A solution with active set S, if there is one: q is in the cone of the columns -M_S and e_i, i not in S.
Vector in_complementary_cone(const Matrix& M, const Vector& q, const std::vector<Index>& S) {
  const Index n = q.size();
  Matrix A = Matrix::Identity(n, n);
  for (const Index s : S) A.col(s) = -M.col(s);
  const Vector x = nonnegative_least_squares(A, q);
  Vector y = Vector::Zero(n);
  y(S) = x(S);
  return y;
}

// A tree of active sets: at each node the indices from `undecided` on are decided, below it w_i and y_i may both be
// positive. Where q is not in the cone of the columns that are left, no set of that branch has a solution.
class Tree {
 public:
  using Admissible = std::function<bool(const std::vector<Index>&)>;

  Tree(const Matrix& M, const Vector& q, const Admissible& admissible)
      : M_(M), q_(q), admissible_(admissible), is_active_(std::size_t(q.size()), 0) {}

  std::optional<Vector> first() {
    const Point root = nearest(q_.size());
    return root.out_of_reach ? std::nullopt : first_below(q_.size(), root);
  }

 private:
  /// w - M y, nearest to q in the cone of a node.
  struct Point {
    Vector w, y;
    bool out_of_reach;
  };

  std::optional<Vector> first_below(Index undecided, const Point& p) {
    if (undecided == 0) return of_set();
    const Index i = undecided - 1;
    for (const bool active : {false, true}) {
      is_active_[std::size_t(i)] = active;
      // Without the column that the branch lacks the point of the node is one of the branch.
      const bool stays = (active ? p.w : p.y)[i] == 0;
      const Point next = stays ? p : nearest(i);
      if (next.out_of_reach) continue;
      if (auto y = first_below(i, next)) return y;
    }
    return std::nullopt;
  }

  // Out of reach by a vector that separates q from the cone: the residual r of nonnegative least squares, with A^T r <=
  // 0 but for rounding. Farther from the cone than this, is_solution accepts nothing.
  Point nearest(Index undecided) const {
    constexpr double farthest = 1e-4, rounding = 1e-10;
    const Index n = q_.size();
    Matrix A(n, n + undecided);
    for (Index i = 0; i < n; ++i)
      A.col(i) = i >= undecided && is_active_[std::size_t(i)] ? Vector(-M_.col(i)) : Vector::Unit(n, i);
    A.rightCols(undecided) = -M_.leftCols(undecided);
    const Vector x = nonnegative_least_squares(A, q_), r = q_ - A * x;
    Point p{x.head(n), Vector::Zero(n), false};
    p.y.head(undecided) = x.tail(undecided);
    for (Index i = undecided; i < n; ++i)
      if (is_active_[std::size_t(i)]) std::swap(p.w[i], p.y[i]);
    const double distance = r.norm();
    p.out_of_reach = distance > farthest * std::sqrt(double(n)) * q_.cwiseAbs().maxCoeff() &&
                     (A.transpose() * r).maxCoeff() <= rounding * distance * A.colwise().norm().maxCoeff();
    return p;
  }

  std::optional<Vector> of_set() const {
    const Index n = q_.size();
    std::vector<Index> S;
    for (Index i = 0; i < n; ++i)
      if (is_active_[std::size_t(i)]) S.push_back(i);
    if (!admissible_(S)) return std::nullopt;
    Vector y = Vector::Zero(n);
    if (!S.empty()) {
      const Eigen::PartialPivLU<Matrix> lu(M_(S, S));
      if (reciprocal_condition(lu) > 1e-13)
        y(S) = Vector(lu.solve(-q_(S))).cwiseMax(0);
      else
        y = in_complementary_cone(M_, q_, S);
    }
    if (is_solution(M_, q_, y)) return y;
    return std::nullopt;
  }

  const Matrix& M_;
  const Vector& q_;
  const Admissible& admissible_;
  std::vector<char> is_active_;
};

}  // namespace

Vector nonnegative_least_squares(const Matrix& A, const Vector& b) {
  const Index n = A.cols();
  Vector x = Vector::Zero(n);
  std::vector<Index> P;  // columns in use
  const double level = 64 * double(n) * epsilon * (b.norm() > 0 ? b.norm() : 1);
  for (Index round = 0; round < 4 * n; ++round) {
    Vector gradient = A.transpose() * (b - A * x);
    for (const Index j : P) gradient[j] = 0;
    Index enters;
    if (n == 0 || !(gradient.maxCoeff(&enters) > level * A.col(enters).norm())) return x;
    P.push_back(enters);
    for (;;) {
      const Vector z = Eigen::ColPivHouseholderQR<Matrix>(A(Eigen::all, P)).solve(b);
      if (z.minCoeff() > 0) {
        x.setZero();
        x(P) = z;
        break;
      }
      double step = 1;  // the longest step from x towards z with a result >= 0
      for (std::size_t k = 0; k < P.size(); ++k)
        if (z[Index(k)] <= 0) step = std::min(step, x[P[k]] / (x[P[k]] - z[Index(k)]));
      for (std::size_t k = 0; k < P.size(); ++k) x[P[k]] += step * (z[Index(k)] - x[P[k]]);
      for (std::size_t k = 0; k < P.size(); ++k)
        if (z[Index(k)] <= 0 && x[P[k]] <= epsilon * x.maxCoeff()) x[P[k]] = 0;
      const std::size_t before = P.size();
      std::erase_if(P, [&x](Index j) { return !(x[j] > 0); });
      if (P.empty() || P.size() == before) return x;
    }
  }
  return x;
}

std::optional<Vector> solve_by_enumeration(const Matrix& M, const Vector& q,
                                           const std::function<bool(const std::vector<Index>&)>& admissible) {
  return Tree(M, q, admissible).first();
}

}  // namespace bromwich
