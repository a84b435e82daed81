#include "core/iteration/forecast.hpp"

#include "core/lcp/comparison.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/lipschitz.hpp"
#include "core/lcp/stencil.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// ||F |W_d| ||_inf for F = <M>^{-1} or L I.
Vector contraction_of_lags(const LcpMatrix& M, const LagTable& table, double L) {
  const Index n = table.outputs;
  const Matrix V = table.modal ? table.basis().matrix() : Matrix();
  const std::optional<Matrix> inverse = inverse_comparison(M);
  Vector kappa(table.W.rows());
  for (Index d = 0; d < kappa.size(); ++d) {
    // The infinity norm of the nonnegative F |W_d| is its largest row sum.
    const Matrix W = table.modal ? Matrix(V * table.W.row(d).asDiagonal() * V.transpose())
                                 : Matrix(Eigen::Map<const RowMatrix>(table.W.row(d).data(), n, table.inputs));
    const Vector rows = W.cwiseAbs().rowwise().sum();
    const double by_norm = L * rows.maxCoeff();
    kappa[d] = inverse ? std::min((*inverse * rows).maxCoeff(), by_norm) : by_norm;
  }
  return kappa;
}

Vector contraction_on_range(const MonotoneRange& range, const LagTable& table) {
  Vector kappa(table.W.rows());
  for (Index d = 0; d < kappa.size(); ++d)
    kappa[d] = range.contraction(Eigen::Map<const RowMatrix>(table.W.row(d).data(), table.outputs, table.inputs));
  return kappa;
}

double transform(const Vector& kappa, double h, double s) {
  double sum = 0;
  for (Index d = 0; d < kappa.size(); ++d) sum += kappa[d] * std::exp(-s * h * double(d));
  return sum;
}

// khat decreases: bisection on a logarithmic scale for khat(s) = 1, s > 0.
double unit_rate(const Vector& kappa, double h) {
  double low = 0, high = 1 / (h * double(kappa.size()));
  while (transform(kappa, h, high) > 1 && high < 1e6 / h) low = high, high *= 2;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (transform(kappa, h, middle) > 1 ? low : high) = middle;
  }
  return high;
}

}  // namespace

double instant_contraction(const LcpMatrix& M, LcpClass lcp_class, const Vector& row_sums) {
  if (is_H_plus(M)) return Comparison(M).solve(row_sums).maxCoeff();
  return has_one_solution(lcp_class) ? solution_lipschitz(M) * row_sums.maxCoeff() : INFINITY;
}

double instant_contraction(const Vector& eigenvalues_of_M, const ModalRecurrence& weights) {
  if (!(eigenvalues_of_M.minCoeff() > 0)) return INFINITY;
  return weights.w0.cwiseAbs().cwiseQuotient(eigenvalues_of_M).maxCoeff();
}

double instant_contraction(const LcpMatrix& M, LcpClass lcp_class, const Weights& weights, const RangeOfM& on) {
  if (const ModalRecurrence* modal = modal_recurrence_of(weights); modal && modal->face.size() > 1)
    if (const auto stencil = stencil_in(modal->face, M)) return instant_contraction(stencil->eigenvalues(), *modal);
  if (on.range && on.range->holds_outputs) return on.range->contraction(first_weight(weights));
  return instant_contraction(M, lcp_class, first_row_sums(weights));
}

Forecast forecast(const LcpMatrix& M, const LagTable& table, double h, double tolerance, const RangeOfM& of_M) {
  Forecast f{solution_lipschitz(M), INFINITY, INFINITY, INFINITY};
  if (!std::isfinite(f.lipschitz) && !of_M.range) return f;
  const Vector kappa =
      of_M.range ? contraction_on_range(*of_M.range, table) : contraction_of_lags(M, table, f.lipschitz);
  const double T = h * double(kappa.size() - 1);
  f.kappa0 = kappa[0];
  if (!(f.kappa0 < 1)) return f;
  f.growth_rate = transform(kappa, h, 0) < 1 ? 0 : unit_rate(kappa, h);
  // The bound is smooth in log s: ten values per decade are enough for its minimum.
  for (int i = 0; i <= 60; ++i) {
    const double s = (f.growth_rate + 1e-3 / T) * std::pow(10.0, i / 10.0);
    const double contraction = transform(kappa, h, s);
    if (contraction < 1) f.sweeps = std::min(f.sweeps, (s * T - std::log(tolerance)) / -std::log(contraction));
  }
  return f;
}

double Forecast::longest_window(double tolerance) const {
  if (!(kappa0 < 0.5)) return 0;
  return growth_rate == 0 ? INFINITY : std::log(tolerance / epsilon) / growth_rate;
}

}  // namespace bromwich
