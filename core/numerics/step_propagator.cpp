#include "core/numerics/step_propagator.hpp"

#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr double taylor_radius = 1;    ///< |A| d of a Taylor series
constexpr int most_taylor_terms = 30;  ///< 1/30! is below rounding
constexpr std::size_t most_levels = 64;

double one_norm(const Matrix& A) { return A.size() > 0 ? A.cwiseAbs().colwise().sum().maxCoeff() : 0; }

// The input restricted to [from, from + length] of [0, 1].
QuadraticInput part_of(const QuadraticInput& u, double from, double length) {
  return {u.c0 + from * u.c1 + from * from * u.c2, length * (u.c1 + 2 * from * u.c2), length * length * u.c2};
}

}  // namespace

StepPropagator::StepPropagator(const Matrix& A, double h) : A_(A), h_(h), norm_(one_norm(A)), levels_(most_levels) {}

const StepPropagator::Level& StepPropagator::level(std::size_t k) {
  if (!levels_[k]) {
    const double length = std::ldexp(h_, -int(k));
    const std::vector<Matrix> p = matrix_phis(length * A_, 3);
    levels_[k] = Level{length, p[0], length * p[1], length * p[2], 2 * length * p[3]};
  }
  return *levels_[k];
}

// X = Σ X_k sigma^k with (k + 1) X_{k+1} = d A X_k + d c_k, at sigma = 1.
void StepPropagator::expand(double d, const QuadraticInput& u, Matrix& X) {
  const std::array<const Matrix*, 3> c{&u.c0, &u.c1, &u.c2};
  sum_ = term_ = X;
  for (int k = 0; k < most_taylor_terms; ++k) {
    X.noalias() = A_ * term_;
    if (k < 3) X += *c[std::size_t(k)];
    term_ = (d / double(k + 1)) * X;
    sum_ += term_;
    // Columns may have very different sizes: the remainder is compared entry by entry.
    if (k >= 2 && (term_.array().abs() <= epsilon / 4 * sum_.array().abs()).all()) break;
  }
  X = sum_;
}

void StepPropagator::advance(double d, const QuadraticInput& u, Matrix& X) {
  double done = 0;
  for (std::size_t k = 0; k < most_levels && norm_ * (d - done) > taylor_radius; ++k) {
    const double length = std::ldexp(h_, -int(k));
    if (length > (d - done) * (1 + 4 * epsilon)) continue;
    const Level& step = level(k);
    const QuadraticInput part = part_of(u, done / d, length / d);
    X = (step.decay * X + step.constant * part.c0 + step.linear * part.c1 + step.quadratic * part.c2).eval();
    done += length;
  }
  if (d - done > 0) expand(d - done, done > 0 ? part_of(u, done / d, (d - done) / d) : u, X);
}

}  // namespace bromwich
