#include "core/dynamics/line_transfer.hpp"

#include "core/base/text.hpp"
#include "core/numerics/phi.hpp"

#include <cmath>
#include <optional>
#include <utility>

namespace bromwich {

namespace {

/// Length of a run of repeated multiplications: its relative error stays below about power_run eps.
constexpr Index power_run = 16;

// The sinh quotients of the discrete Green's function, written with decaying exponentials only: with 2 cosh theta =
// 2 + (z + r) dx^2/c and rho = e^{-theta}, |rho| <= 1, entry (i, j), i <= j, of (zI - line)^{-1} is
//
//     dx^2/c rho^{1+j-i} (1 - rho^{2i})/(1 - rho^2) (1 - rho^{2(Q+1-j)})/(1 - rho^{2(Q+1)})
//
// with Dirichlet ends. An end that reflects by q replaces 1 - rho^{2i} by 1 - a rho^{2i}, a = (1 - q/rho)/(1 - q rho),
// and so at the other end; below, a product of both in place of the last 1. Written with 1 - a = e/rho, e = q (1 -
// rho^2)/ (1 - q rho), which does not cancel.
class Green {
 public:
  Green(const SecondDifference& line, Complex z)
      : Q_(line.points), first_(line.first), last_(line.last), scale_(line.spacing * line.spacing / line.diffusivity) {
    z += line.decay;
    const Complex s = z * scale_, root = std::sqrt(s * (1.0 + 0.25 * s)), grown = 1.0 + 0.5 * s;
    const Complex plus = grown + root, minus = grown - root;
    const double plus_size = std::norm(plus), minus_size = std::norm(minus);
    rho_ = plus_size >= minus_size ? std::conj(plus) / plus_size : std::conj(minus) / minus_size;
    log_norm_ = -std::log(std::max(plus_size, minus_size));
    s_ = s;
    end_ = decay(Q_ + 1);
    if (first_ != 0 || last_ != 0) end_ += reflected_end();
  }

  Complex operator()(Index i, Index j) const {
    if (i > j) std::swap(i, j);
    const Complex far = j == i ? rho_ : std::exp(-double(1 + j - i) * theta());
    return scale_ * far * near(i) * behind(j) / end_;
  }

  // Row i: powers of rho by repeated multiplication.
  void add_row(Index i, double factor, ComplexVector& row) const {
    for (Index j = 1; j < i; ++j) row[j - 1] += factor * (*this)(i, j);
    const Complex left = factor * scale_ * near(i) / end_;
    Complex power = rho_;
    for (Index j = i; j <= Q_; ++j) {
      if ((j - i) % power_run == 0) power = std::exp(-double(1 + j - i) * theta());
      row[j - 1] += left * power * behind(j);
      power *= rho_;
      if (std::norm(power) < 1e-40) break;
    }
  }

 private:
  // Formed where it is needed: far from the spectrum a line does not see its other end. log rho from rho loses relative
  // accuracy where rho is close to 1; asinh keeps it.
  Complex theta() const {
    if (!theta_) {
      theta_ = std::norm(1.0 - rho_) < 0.01 ? 2.0 * std::asinh(0.5 * std::sqrt(s_)) : -std::log(rho_);
      if (theta_->real() < 0) theta_ = -*theta_;
    }
    return *theta_;
  }
  // 1 - rho^{2k}; below rounding the power is not formed.
  Complex decay(Index k) const { return double(k) * log_norm_ < -37 ? Complex(1) : -expm1(-2.0 * double(k) * theta()); }
  // rho^k; below 1e-17 it counts as 0.
  Complex rho_to(Index k) const { return double(k) * log_norm_ < -78 ? Complex(0) : std::exp(-double(k) * theta()); }
  // q / (1 - q rho)
  Complex reflected(double q) const { return q == 0 ? Complex(0) : q / (1 - q - q * expm1(-theta())); }
  Complex near(Index i) const {
    const Complex plain = i == 1 ? Complex(1) : decay(i) / decay(1);
    return first_ == 0 ? plain : plain + reflected(first_) * rho_to(2 * i - 1);
  }
  Complex behind(Index j) const {
    const Index k = Q_ + 1 - j;
    return last_ == 0 ? decay(k) : decay(k) + reflected(last_) * decay(1) * rho_to(2 * k - 1);
  }
  // (1 - a a') rho^{2(Q+1)}, a and a' of the two ends.
  Complex reflected_end() const {
    const Complex e = reflected(first_) * decay(1), other = reflected(last_) * decay(1);
    return (e + other) * rho_to(2 * Q_ + 1) - e * other * rho_to(2 * Q_);
  }

  Index Q_;
  double first_, last_;      ///< reflections
  double scale_, log_norm_;  ///< log |rho|^2
  Complex s_, rho_, end_;
  mutable std::optional<Complex> theta_;
};

}  // namespace

ComplexVector green_row(const SecondDifference& across, const Vector& n, Complex z) {
  const Green green(across, z);
  ComplexVector row = ComplexVector::Zero(across.points);
  for (Index i = 0; i < n.size(); ++i)
    if (n[i] != 0) green.add_row(i + 1, n[i], row);
  return row;
}

LineTransfer::LineTransfer(const SecondDifference& across, const Vector& n, const Vector& b) : across_(across) {
  for (Index i = 0; i < n.size(); ++i)
    for (Index j = 0; n[i] != 0 && j < b.size(); ++j)
      if (b[j] != 0) terms_.push_back({i + 1, j + 1, n[i] * b[j]});
}

Complex LineTransfer::operator()(Complex z) const {
  const Green green(across_, z);
  Complex sum = 0;
  for (const Term& t : terms_) sum += t.factor * green(t.i, t.j);
  return sum;
}

}  // namespace bromwich
