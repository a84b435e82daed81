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
constexpr Index groups_together = 64;    ///< of a thread

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

// All rates.
ShellFit whole(Index K) {
  ShellFit fit{std::vector<Index>(std::size_t(K)), Vector::Ones(K), 0};
  std::iota(fit.order.begin(), fit.order.end(), Index(0));
  return fit;
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
  ShellFit best = whole(K);
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

ShellFit fit_mode(const ModalRecurrence& r, Index l, Index steps, Index rounding) {
  const Index K = r.exponentials();
  Vector x(K), c(K);
  for (Index k = 0; k < K; ++k) {
    const double E = r.decay(k, l);
    x[k] = E > 0 ? std::log(E) : -750;
    const double p = phi1(x[k]);
    c[k] = r.output(k, l) / (p * p);
  }
  return fit_shell(x, c, steps, rounding);
}

// The slowest mode of a group, and its slowest rate times the step.
struct Slowest {
  Index mode;
  double speed;
};

Slowest slowest_of(const ModalRecurrence& r, Index first, Index count) {
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(count);
  for (Index k = 0; k < r.exponentials(); ++k) sum += r.decay.row(k).segment(first, count);
  Index slowest = 0;
  sum.maxCoeff(&slowest);
  return {first + slowest, -std::log(std::max(r.decay.col(first + slowest).maxCoeff(), 1e-300))};
}

}  // namespace

Shells find_shells(const HostThreads& threads, const ModalRecurrence& r, Index steps, Index together, Index rounding) {
  const Index n = r.modes(), groups = (n + together - 1) / together;
  Shells shells{together, {whole(r.exponentials())}, std::vector<Index>(std::size_t(groups), 0), 0};
  if (r.exponentials() == 0) return shells;
  std::vector<Slowest> slowest(static_cast<std::size_t>(groups));
  const auto last = [&](Index g) { return std::min((g + 1) * together, n) - 1; };
  threads.each_range(groups, groups_together, [&](Index from, Index to) {
    for (Index g = from; g < to; ++g) slowest[std::size_t(g)] = slowest_of(r, g * together, last(g) + 1 - g * together);
  });
  // From the slowest group on: the first of a level has the slowest mode of all that share its fit.
  std::vector<Index> order(static_cast<std::size_t>(groups));
  std::iota(order.begin(), order.end(), Index(0));
  std::stable_sort(order.begin(), order.end(),
                   [&](Index a, Index b) { return slowest[std::size_t(a)].speed < slowest[std::size_t(b)].speed; });
  std::map<std::pair<Index, int>, Index> fits;  // by the family and the level of the slowest mode
  std::vector<Index> fitted{0};                 // the mode of each fit
  for (const Index g : order) {
    if (r.family(g * together) != r.family(last(g))) continue;  // a fit is for one family
    const auto& [mode, speed] = slowest[std::size_t(g)];
    const int level = int(std::floor(levels_per_octave * 2 * std::log2(std::max(speed, 1e-12))));
    const auto [place, is_new] = fits.try_emplace({r.family(mode), level}, Index(fitted.size()));
    if (is_new) fitted.push_back(mode);
    shells.of_group[std::size_t(g)] = place->second;
  }
  shells.fits.resize(fitted.size());
  threads.each_range(Index(fitted.size()) - 1, 1, [&](Index i, Index) {
    shells.fits[std::size_t(i) + 1] = fit_mode(r, fitted[std::size_t(i) + 1], steps, rounding);
  });
  for (const ShellFit& fit : shells.fits) shells.error = std::max(shells.error, fit.error);
  return shells;
}

ModalRecurrence in_shells(const ModalRecurrence& r, const Shells& shells) {
  const Index K = r.exponentials();
  ModalRecurrence s = r;
  for (Index g = 0; g < Index(shells.of_group.size()); ++g) {
    const ShellFit& fit = shells.of(g);
    const Index kept = shells.kept(g), first = g * shells.together,
                count = std::min(shells.together, r.modes() - first);
    if (kept == K) continue;
    const auto part = [&](auto& table, Index k) { return table.row(k).segment(first, count); };
    Eigen::RowVectorXd lag1 = Eigen::RowVectorXd::Zero(count), of_start = lag1;
    for (Index k = 0; k < K; ++k) {
      lag1 += part(r.output, k);
      of_start += part(r.output, k).cwiseProduct(part(r.start, k));
    }
    for (Index k = 0; k < K; ++k) {
      if (k < kept) {
        const Index from = fit.order[std::size_t(k)];
        part(s.decay, k) = part(r.decay, from);
        part(s.output, k) = fit.factors[k] * part(r.output, from);
        part(s.start, k) = part(r.start, from);
      } else {
        for (RowMatrix* table : {&s.decay, &s.output, &s.start}) part(*table, k).setZero();
      }
      lag1 -= part(s.output, k);
      of_start -= part(s.output, k).cwiseProduct(part(s.start, k));
    }
    s.w1.segment(first, count) += lag1.transpose();
    s.s1.segment(first, count) += of_start.transpose();
  }
  return s;
}

}  // namespace bromwich
