#include "core/seam/recurrence.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

// sin a sin b is a difference of cosines. Hence entry (i, j) is c(i-j) - c(i+j), a Toeplitz minus a Hankel matrix, with
// c(d) = 1/(n+1) Σ_k w0_k cos(pi k d/(n+1)).
Matrix implicit_part(const ModalRecurrence& r) {
  if (r.face.size() > 1 || !r.face.is_sine()) {
    const Matrix V = r.face.matrix();
    return V * r.w0.asDiagonal() * V.transpose();
  }
  const Index n = r.modes(), period = 2 * (n + 1);
  Vector cosine(period), c = Vector::Zero(n + 2);
  for (Index a = 0; a < period; ++a) cosine[a] = std::cos(std::numbers::pi * double(a) / double(n + 1)) / double(n + 1);
  for (Index d = 0; d < c.size(); ++d)
    for (Index k = 0; k < n; ++k) c[d] += r.w0[k] * cosine[(k + 1) * d % period];
  Matrix W(n, n);
  for (Index j = 1; j <= n; ++j)
    for (Index i = 1; i <= n; ++i) W(i - 1, j - 1) = c[std::abs(i - j)] - c[std::min(i + j, period - i - j)];
  return W;
}

double growth(const RowMatrix& W) {
  const Index half = W.rows() / 2;
  const double early = half > 0 ? W.topRows(half).cwiseAbs().maxCoeff() : 0,
               late = W.bottomRows(W.rows() - half).cwiseAbs().maxCoeff();
  return early > 0 && late > 10 * early ? std::log(late / early) / double(half) : 0;
}

Vector damping(double sigma, Index rows) {
  Vector e(rows);
  for (Index j = 0; j < rows; ++j) e[j] = std::exp(-sigma * double(j));
  return e;
}

Matrix matrix_power(Matrix base, Index exponent) {
  Matrix result = Matrix::Identity(base.rows(), base.cols());
  for (; exponent > 0; exponent /= 2, base = (base * base).eval())
    if (exponent % 2 != 0) result = (result * base).eval();
  return result;
}

ModalRecurrence part_of(const StageRecurrence& r, int a, int b) {
  const Index n = r.modes();
  ModalRecurrence part;
  part.decay = r.decay;
  part.output = r.output[a].cwiseProduct(r.input[b]);
  part.start = RowMatrix::Zero(r.exponentials(), n);
  part.w0 = r.w0[a][b];
  part.w1 = b == 1 ? r.w1[a] : Vector(Vector::Zero(n));
  part.s1 = Vector::Zero(n);
  return part;
}

}  // namespace bromwich
