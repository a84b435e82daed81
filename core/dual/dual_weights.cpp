#include "core/dual/dual_weights.hpp"

#include "core/base/text.hpp"
#include "core/dynamics/line_transfer.hpp"
#include "core/lcp/stencil.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index sampled_modes = 24;          ///< of the sample for the smoothing factor
constexpr Index circle_points = 96;          ///< on half of |zeta| = 1, for the number of zeros inside
constexpr Index modes_together = 16;         ///< for one thread
constexpr double negligible_direct = 1e-10;  ///< relative: a coefficient that vanishes

// ---- Kronecker sums ----

class ModalInverse {
 public:
  ModalInverse(const DiscreteProblem& p, Vector M, Index stages)
      : p_(p),
        stages_(stages),
        d_(*p.modes()),
        M_(std::move(M)),
        mu_(d_.face_eigenvalues()),
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
    const std::vector<Complex> boundary = rule_boundary(stages_, p_.h, p_.J, circle_points);
    std::vector<std::string> why(std::size_t(M_.size()));
    p_.backend.each_range(M_.size(), modes_together, [&](Index first, Index last) {
      for (Index l = first; l < last; ++l) why[std::size_t(l)] = zeros_of(l, boundary);
    });
    for (std::string& of_mode : why)
      if (!of_mode.empty()) return std::move(of_mode);
    return "";
  }

  std::string zeros_of(Index l, const std::vector<Complex>& boundary) const {
    if (!(symbol(l, 1 / p_.h).real() > 0)) return "M + W_0 of implicit Euler is not positive in all modes";
    double turned = 0;
    Complex before = symbol(l, 0);
    for (const Complex& z : boundary) {
      const Complex now = symbol(l, z);
      if (!(std::abs(now) > 0)) return "M + N (zI - A)^{-1} B is singular";
      turned += std::arg(now / before);
      before = now;
    }
    if (std::abs(turned) > 1 || !(symbol(l, 0).real() >= 0))
      return text("V grows: M + N (zI - A)^{-1} B has zeros in the right half-plane (mode %ld)", long(l + 1));
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
    const FitRegion region{stages_ == 2, p_.h, p_.scene.T, -mu_.maxCoeff(), -mu_.minCoeff()};
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
    DualWeights weights;
    const Index n = M_.size();
    const auto inverse = [this](Index l, Complex z) { return 1.0 / symbol(l, z); };
    if (stages_ == 2) {
      auto V = std::make_shared<const StageRecurrence>(stage_recurrence(sum, mu_, p_.h, inverse));
      if (!is_positive(*V)) return refused_dual("the problem of both stages is not known to be P");
      weights.stage_weights = std::move(V);
    } else {
      weights.weights = share_weights(Recurrence(recurrence(sum)));
    }
    const Index modes = std::min(n, sampled_modes);
    const ModeSymbols symbols = [&](Complex z) {
      ComplexVector values(modes);
      for (Index i = 0; i < modes; ++i) values[i] = inverse(modes > 1 ? i * (n - 1) / (modes - 1) : 0, z);
      return values;
    };
    const SweepChoice choice = choose_sweep(symbols, p_.h, stages_, dual_sweeps, 1);
    weights.P = Tridiagonal{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
    weights.shift = choice.shift;
    weights.shifts = choice.shifts;
    weights.stage_divisors = choice.stages;
    weights.smoothing = choice.smoothing;
    weights.contraction = choice.contraction;
    weights.error = sum.error;
    weights.description = text("V: %ld exponentials a mode", long(sum.rates.size()));
    weights.fit = std::move(fit);
    return {std::move(weights), ""};
  }

  // V_0 of both stages is positive definite with the quadrature weights 3/4, 1/4 on its rows, so that it is P.
  static bool is_positive(const StageRecurrence& V) {
    for (Index l = 0; l < V.modes(); ++l) {
      const double a = 0.75 * V.w0[0][0][l], d = 0.25 * V.w0[1][1][l],
                   b = 0.5 * (0.75 * V.w0[0][1][l] + 0.25 * V.w0[1][0][l]);
      if (!(a > 0 && a * d > b * b)) return false;
    }
    return true;
  }

  // c/(z - sigma) has the weights c h E^{d+1}, E = 1/(1 - h sigma); a z has a/h and -a/h.
  ModalRecurrence recurrence(const PoleSum& sum) const {
    const Index n = M_.size(), K = sum.rates.size();
    ModalRecurrence V;
    V.face = p_.face();
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
  Index stages_;
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

std::vector<Complex> rule_boundary(Index stages, double h, Index J, Index points) {
  std::vector<Complex> boundary, back;
  const double from = 0.01 / double(J);
  for (Index i = 0; i <= points; ++i) {
    const double angle = from * std::pow(std::numbers::pi / from, double(i) / double(points));
    const double half = std::sin(angle / 2);
    const Complex small(2 * half * half, std::sin(angle));  // 1 - e^{-i angle} without cancellation
    if (stages == 1) {
      boundary.push_back(small / h);
      continue;
    }
    const RadauPoints z = radau_frequencies(1.0 - small, h);
    boundary.push_back(z.first);
    back.push_back(std::conj(z.second));
  }
  boundary.insert(boundary.end(), back.rbegin(), back.rend());
  return boundary;
}

DualChoice dual_weights(const DiscreteProblem& p, Index stages, const DualWeights* finer) {
  if (p.small_state()) return stages == 1 ? dense_dual_weights(p) : refused_dual("dense dynamics have no stages");
  if (!p.modes()) return fitted_dual_weights(p, stages, finer);
  if (p.modes()->both_faces) return refused_dual("contact on two sides has no inverse in modes here");
  auto M = eigenvalues_in(p.face(), p.scene.M);
  if (!M) return refused_dual("the modes of the face do not diagonalise M");
  return ModalInverse(p, std::move(*M), stages).choose(finer ? finer->fit : nullptr);
}

}  // namespace bromwich
