#include "core/dual/dual_weights.hpp"

#include "core/base/text.hpp"
#include "core/dynamics/line_transfer.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index sampled_modes = 24;          ///< of the sample for the smoothing factor
constexpr Index circle_points = 96;          ///< on half of |zeta| = 1, for the number of zeros inside
constexpr double negligible_direct = 1e-10;  ///< relative: a coefficient that vanishes

// z of implicit Euler at zeta = e^{i angle}, in the upper half-plane.
Complex euler_point(double angle, double h) {
  const double half = std::sin(angle / 2);
  return Complex(2 * half * half, std::sin(angle)) / h;
}

// ---- Kronecker sums ----

class ModalInverse {
 public:
  ModalInverse(const DiscreteProblem& p, Vector M)
      : p_(p),
        d_(*p.modes()),
        M_(std::move(M)),
        mu_(d_.along.eigenvalues()),
        nu_(d_.across.eigenvalues()),
        line_(d_.across, d_.n, d_.b) {}

  DualChoice choose(std::shared_ptr<const PoleSum> known) const {
    if (known) return with(std::move(known));
    const double direct = d_.n.dot(d_.b), terms = d_.n.cwiseAbs().dot(d_.b.cwiseAbs());
    const double largest = M_.cwiseAbs().maxCoeff();
    if (largest == 0 && terms == 0 && line_(1 / p_.h) == 0.0) return refused_dual("M + K is zero: N and B do not meet");
    if (M_.cwiseAbs().minCoeff() == 0 && !(std::abs(direct) > negligible_direct * terms))
      return refused_dual(two_derivatives);
    if (const std::string why = zeros(); !why.empty()) return refused_dual(why);
    return fit();
  }

 private:
  Complex symbol(Index l, Complex z) const { return M_[l] + line_(z - mu_[l]); }

  // Zeros of the symbol in |zeta| < 1 by the argument principle: twice the change of the argument over the upper half.
  std::string zeros() const {
    for (Index l = 0; l < M_.size(); ++l) {
      if (!(symbol(l, 1 / p_.h).real() > 0)) return "M + W_0 of implicit Euler is not positive in all modes";
      double turned = 0;
      Complex before = symbol(l, 0);
      for (Index i = 0; i <= circle_points; ++i) {
        const double from = 0.01 / double(p_.J);
        const double angle = from * std::pow(std::numbers::pi / from, double(i) / double(circle_points));
        const Complex now = symbol(l, euler_point(angle, p_.h));
        if (!(std::abs(now) > 0)) return "M + N (zI - A)^{-1} B is singular";
        turned += std::arg(now / before);
        before = now;
      }
      if (std::abs(turned) > 1 || !(symbol(l, 0).real() >= 0))
        return text("V grows: M + N (zI - A)^{-1} B has zeros in the right half-plane (mode %ld)", long(l + 1));
    }
    return "";
  }

  bool same_M() const { return M_.maxCoeff() - M_.minCoeff() <= 4 * epsilon * M_.cwiseAbs().maxCoeff(); }

  DualChoice fit() const {
    const Index functions = same_M() ? 1 : M_.size();
    const TransferFunctions inverse = [&](Complex z) {
      const Complex k = line_(z);
      ComplexVector v(functions);
      for (Index i = 0; i < functions; ++i) v[i] = 1.0 / (M_[i] + k);
      return v;
    };
    const FitRegion region{false, p_.h, p_.scene.T, -mu_.maxCoeff(), -mu_.minCoeff()};
    // Poles of V^ lie between those of k, and one near -n^T b / M^, which acts like a polynomial if it is far away.
    const double near = std::max(-nu_.minCoeff(), 2 / p_.h), direct = std::abs(d_.n.dot(d_.b));
    const double fastest = 4 * std::clamp(direct / std::max(M_.minCoeff(), 1e-300), near, 1e4 * near);
    auto sum =
        std::make_shared<const PoleSum>(fit_poles(inverse, functions, region, -0.3 * nu_.maxCoeff(), fastest, true));
    if (!(sum->error <= accepted_fit_error))
      return refused_dual(
          text("V is no short sum of decaying exponentials: the best one misses %.1e of it", sum->error));
    return with(std::move(sum));
  }

  // The weights of this grid, with the d of its sweeps.
  DualChoice with(std::shared_ptr<const PoleSum> fit) const {
    const PoleSum& sum = *fit;
    ModalRecurrence V = recurrence(sum);
    std::vector<Complex> values;
    const Index n = M_.size(), modes = std::min(n, sampled_modes);
    for (Index i = 0; i < modes; ++i) {
      const Index l = modes > 1 ? i * (n - 1) / (modes - 1) : 0;
      for (Index f = 0; f < high_frequencies; ++f)
        values.push_back(1.0 / symbol(l, euler_point(high_frequency(f), p_.h)));
    }
    const auto [divisor, factor] = best_divisor(values);
    DualWeights weights;
    weights.P = Tridiagonal{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
    weights.shift = divisor;
    weights.weights = share_weights(Recurrence(std::move(V)));
    weights.smoothing = factor;
    weights.error = sum.error;
    weights.description = text("V: %ld exponentials a mode", long(sum.rates.size()));
    weights.fit = std::move(fit);
    return {std::move(weights), ""};
  }

  // c/(z - sigma) has the weights c h E^{d+1}, E = 1/(1 - h sigma); a z has a/h and -a/h.
  ModalRecurrence recurrence(const PoleSum& sum) const {
    const Index n = M_.size(), K = sum.rates.size();
    ModalRecurrence V;
    V.decay.resize(K, n);
    V.output.resize(K, n);
    V.start = RowMatrix::Zero(K, n);
    V.w0.resize(n);
    V.w1.resize(n);
    V.s1 = Vector::Zero(n);
    for (Index l = 0; l < n; ++l) {
      const Index column = sum.functions() > 1 ? l : 0;
      for (Index k = 0; k < K; ++k) {
        const double E = 1 / (1 - p_.h * (sum.rates[k] + mu_[l]));
        V.decay(k, l) = E;
        V.output(k, l) = sum.coefficients(k, column) * p_.h * E * E;
      }
      V.w0[l] = 1 / symbol(l, 1 / p_.h).real();
      V.w1[l] = -sum.linear[column] / p_.h;
    }
    return V;
  }

  const DiscreteProblem& p_;
  const KroneckerDynamics& d_;
  Vector M_, mu_, nu_;
  LineTransfer line_;
};

}  // namespace

DualChoice refused_dual(std::string why) { return {std::nullopt, std::move(why)}; }

std::pair<double, double> best_divisor(const std::vector<Complex>& values) {
  double largest = 0;
  for (const Complex& v : values) largest = std::max(largest, std::abs(v));
  std::pair<double, double> best{largest, INFINITY};
  for (int i = 0; i <= 80; ++i) {
    const double d = largest * (0.4 + 0.02 * double(i));
    double worst = 0;
    for (const Complex& v : values) worst = std::max(worst, std::abs(1.0 - v / d));
    if (worst < best.second) best = {d, worst};
  }
  return best;
}

double high_frequency(Index i) { return std::numbers::pi * (0.25 + 0.75 * double(i) / double(high_frequencies - 1)); }

std::optional<Vector> eigenvalues_in_modes(const LcpMatrix& matrix) {
  const Index n = size(matrix);
  double a = 0, b = 0;
  if (const auto* M = std::get_if<Tridiagonal>(&matrix)) {
    if (n > 0) a = M->diagonal[0];
    if (n > 1) b = M->upper[0];
    for (Index i = 0; i < n; ++i)
      if (M->diagonal[i] != a || (i > 0 && M->lower[i] != b) || (i + 1 < n && M->upper[i] != b)) return std::nullopt;
  } else {
    const Matrix full = to_dense(matrix);
    if (n > 0) a = full(0, 0);
    if (n > 1) b = full(0, 1);
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i)
        if (full(i, j) != (i == j ? a : std::abs(i - j) == 1 ? b : 0)) return std::nullopt;
  }
  Vector values(n);
  for (Index l = 0; l < n; ++l) values[l] = a + 2 * b * std::cos(std::numbers::pi * double(l + 1) / double(n + 1));
  return values;
}

DualChoice dual_weights(const DiscreteProblem& p, const DualWeights* finer) {
  if (p.small_state()) return dense_dual_weights(p);
  if (!p.modes()) return refused_dual("V is made for dense dynamics and Kronecker sums");
  auto M = eigenvalues_in_modes(p.scene.M);
  if (!M) return refused_dual("sine modes do not diagonalise M");
  return ModalInverse(p, std::move(*M)).choose(finer ? finer->fit : nullptr);
}

}  // namespace bromwich
