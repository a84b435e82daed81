#include "core/numerics/precise_phi.hpp"

#include <cmath>
#include <vector>

namespace bromwich {

namespace {

// The sum of two doubles, the second below half a unit in the last place of the first (Dekker, Numer. Math. 18, 1971).
struct Pair {
  double high = 0, low = 0;
};

Pair two_sum(double a, double b) {
  const double sum = a + b, part = sum - a;
  return {sum, (a - (sum - part)) + (b - part)};
}

Pair two_product(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

Pair operator+(Pair a, Pair b) {
  const Pair high = two_sum(a.high, b.high), low = two_sum(a.low, b.low);
  const Pair sum = two_sum(high.high, high.low + low.high);
  return two_sum(sum.high, sum.low + low.low);
}

Pair operator*(Pair a, Pair b) {
  const Pair product = two_product(a.high, b.high);
  return two_sum(product.high, product.low + (a.high * b.low + a.low * b.high));
}

Pair divided(double a, double b) {
  const double q = a / b;
  return two_sum(q, std::fma(-q, b, a) / b);
}

// m x m, row by row.
class PairMatrix {
 public:
  explicit PairMatrix(Index m) : m_(m), entries_(std::size_t(m * m)) {}

  Index size() const { return m_; }
  Pair& at(Index i, Index j) { return entries_[std::size_t(i * m_ + j)]; }
  const Pair& at(Index i, Index j) const { return entries_[std::size_t(i * m_ + j)]; }

  void scale(double power_of_two) {
    for (Pair& p : entries_) p = {p.high * power_of_two, p.low * power_of_two};
  }
  void add(const PairMatrix& other) {
    for (std::size_t k = 0; k < entries_.size(); ++k) entries_[k] = entries_[k] + other.entries_[k];
  }
  void add_to_diagonal(Pair value) {
    for (Index i = 0; i < m_; ++i) at(i, i) = at(i, i) + value;
  }
  Matrix rounded() const {
    Matrix values(m_, m_);
    for (Index i = 0; i < m_; ++i)
      for (Index j = 0; j < m_; ++j) values(i, j) = at(i, j).high;
    return values;
  }

 private:
  Index m_;
  std::vector<Pair> entries_;
};

PairMatrix operator*(const PairMatrix& a, const PairMatrix& b) {
  const Index m = a.size();
  PairMatrix product(m);
  for (Index i = 0; i < m; ++i)
    for (Index k = 0; k < m; ++k) {
      const Pair factor = a.at(i, k);
      if (factor.high == 0) continue;
      for (Index j = 0; j < m; ++j) product.at(i, j) = product.at(i, j) + factor * b.at(k, j);
    }
  return product;
}

constexpr int taylor_terms = 28;  ///< of phi_2 at norms up to 1: the remainder is below 1/30! = 2^-107

// Σ_k X^k/(k + 2)!, by Horner's rule.
PairMatrix taylor(const PairMatrix& X) {
  std::vector<Pair> inverse{{0.5, 0}};  // 1/(k+2)!
  for (int k = 1; k < taylor_terms; ++k) inverse.push_back(inverse.back() * divided(1, double(k + 2)));
  PairMatrix sum(X.size());
  for (int k = taylor_terms; k-- > 0;) {
    if (k + 1 < taylor_terms) sum = X * sum;
    sum.add_to_diagonal(inverse[std::size_t(k)]);
  }
  return sum;
}

}  // namespace

MatrixPhi precise_phi(const Matrix& A, double h) {
  const Index m = A.rows();
  const double norm = m > 0 ? h * A.cwiseAbs().colwise().sum().maxCoeff() : 0;
  const int doublings = norm > 1 ? int(std::ceil(std::log2(norm))) : 0;
  PairMatrix X(m);
  for (Index i = 0; i < m; ++i)
    for (Index j = 0; j < m; ++j) X.at(i, j) = two_product(A(i, j), h);
  X.scale(std::ldexp(1.0, -doublings));
  PairMatrix p2 = taylor(X), p1 = X * p2;
  p1.add_to_diagonal({1, 0});
  PairMatrix e = X * p1;
  e.add_to_diagonal({1, 0});
  for (int i = 0; i < doublings; ++i) {
    PairMatrix next = p1 * p1;  // phi_2(2X) = (phi_1^2 + 2 phi_2)/4
    next.scale(0.5);
    next.add(p2);
    next.scale(0.5);
    p2 = std::move(next);
    next = e * p1;  // phi_1(2X) = (e^X + 1) phi_1/2
    next.add(p1);
    next.scale(0.5);
    p1 = std::move(next);
    e = e * e;
  }
  return {e.rounded(), p1.rounded(), p2.rounded()};
}

}  // namespace bromwich
