#include "core/kernel/shells.hpp"

#include "core/numerics/phi.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

namespace bromwich {

namespace {

constexpr double shell_tolerance = 1e-13, accepted_shell_error = 1e-11;
constexpr double levels_per_octave = 1;  ///< of the decay of the slowest mode of a group, for which fits are shared

/// Σ_k c_k e^{x_k t} with the rates of `order`, the first ones, for t from 1 to the number of steps.
struct ShellFit {
  std::vector<Index> order;  ///< of the rates that are kept
  Vector factors;            ///< their new coefficients over the old ones
  double error = 0;
};

Vector sample_steps(Index steps) {
  const Index count = 40 + Index(14 * std::log(double(std::max<Index>(steps, 2))));
  Vector t(count);
  for (Index i = 0; i < count; ++i) t[i] = std::pow(double(std::max<Index>(steps, 2)), double(i) / double(count - 1));
  return t;
}

Matrix values_at(const Vector& t, const Vector& x) {
  constexpr double least = -340;
  const Matrix exponents = t * x.transpose();
  return (exponents.array() < least).select(0, exponents.array().exp());
}

// x: rates times the step, negative; c: coefficients.
ShellFit fit_shell(const Vector& x, const Vector& c, Index steps, Index rounding) {
  const Index K = x.size();
  const Vector t = sample_steps(steps);
  const Vector between = (t.head(t.size() - 1).array() * t.tail(t.size() - 1).array()).sqrt();
  const Matrix all = values_at(t, x), check = values_at(between, x);
  const Vector wanted = all * c, wanted_between = check * c;
  const double scale = std::max(wanted.cwiseAbs().maxCoeff(), 1e-300);
  const Eigen::ColPivHouseholderQR<Matrix> qr(all);
  ShellFit best{std::vector<Index>(std::size_t(K)), Vector::Ones(K), 0};
  std::iota(best.order.begin(), best.order.end(), Index(0));
  for (Index kept = std::min(rounding, K); kept < K; kept += rounding) {
    ShellFit fit;
    for (Index k = 0; k < kept; ++k) fit.order.push_back(qr.colsPermutation().indices()[k]);
    const Vector found = Matrix(all(Eigen::all, fit.order)).householderQr().solve(wanted);
    fit.error = (check(Eigen::all, fit.order) * found - wanted_between).cwiseAbs().maxCoeff() / scale;
    fit.factors = found.cwiseQuotient(c(fit.order));
    if (fit.error <= shell_tolerance && fit.factors.allFinite()) return fit;
    if (fit.error <= accepted_shell_error && kept + rounding >= K && fit.factors.allFinite()) best = fit;
  }
  return best;
}

}  // namespace

Shells in_shells(const ModalRecurrence& r, Index steps, Index together, Index rounding) {
  const Index n = r.modes(), K = r.exponentials();
  Shells shells{r, {}, 0};
  ModalRecurrence& s = shells.recurrence;
  std::map<std::pair<Index, int>, ShellFit> fits;  // by the family and the level of the slowest mode
  const auto slowest_of = [&](Index first, Index last) {
    Index slowest = first;
    for (Index l = first; l < last; ++l)
      if (r.decay.col(l).sum() > r.decay.col(slowest).sum()) slowest = l;
    return slowest;
  };
  const auto fit_of = [&](Index l) {
    const Vector E = r.decay.col(l);
    Vector x(K), c(K);
    for (Index k = 0; k < K; ++k) {
      x[k] = E[k] > 0 ? std::log(E[k]) : -750;
      const double p = phi1(x[k]);
      c[k] = r.output(k, l) / (p * p);
    }
    return fit_shell(x, c, steps, rounding);
  };
  // From the slowest group on: the first of a level has the slowest mode of all that share its fit.
  std::vector<Index> groups, slowest;
  for (Index first = 0; first < n; first += together) {
    groups.push_back(Index(groups.size()));
    slowest.push_back(slowest_of(first, std::min(first + together, n)));
  }
  shells.counts.assign(groups.size(), K);
  const auto speed = [&](Index l) { return -std::log(std::max(r.decay.col(l).maxCoeff(), 1e-300)); };
  std::stable_sort(groups.begin(), groups.end(),
                   [&](Index a, Index b) { return speed(slowest[std::size_t(a)]) < speed(slowest[std::size_t(b)]); });
  for (const Index g : groups) {
    if (r.family(g * together) != r.family(std::min((g + 1) * together, n) - 1)) continue;  // a fit is for one family
    const Index l0 = slowest[std::size_t(g)];
    const int level = int(std::floor(levels_per_octave * 2 * std::log2(std::max(speed(l0), 1e-12))));
    const auto [place, is_new] = fits.try_emplace({r.family(l0), level});
    if (is_new) place->second = fit_of(l0);
    const ShellFit& fit = place->second;
    const Index kept = Index(fit.order.size());
    shells.counts[std::size_t(g)] = kept;
    shells.error = std::max(shells.error, fit.error);
    if (kept == K) continue;
    for (Index l = g * together; l < std::min((g + 1) * together, n); ++l) {
      double lag1 = 0, of_start = 0;
      for (Index k = 0; k < K; ++k) lag1 += r.output(k, l), of_start += r.output(k, l) * r.start(k, l);
      for (Index k = 0; k < K; ++k) {
        const Index from = k < kept ? fit.order[std::size_t(k)] : 0;
        s.decay(k, l) = k < kept ? r.decay(from, l) : 0;
        s.output(k, l) = k < kept ? r.output(from, l) * fit.factors[k] : 0;
        s.start(k, l) = k < kept ? r.start(from, l) : 0;
        lag1 -= s.output(k, l);
        of_start -= s.output(k, l) * s.start(k, l);
      }
      s.w1[l] += lag1;
      s.s1[l] += of_start;
    }
  }
  return shells;
}

}  // namespace bromwich
