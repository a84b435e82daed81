#include "core/compression.hpp"

#include "core/error.hpp"
#include "core/phi.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// k(t) = n^T e^{across t} b at the times given (ascending), from one contour per window of ratio 5.
Vector line_kernel(const KroneckerDynamics& d, const ContourParameters& parameters, const Vector& times) {
  const LineTransfer transfer(d.across, d.n, d.b);
  Vector values(times.size());
  for (Index i = 0; i < times.size();) {
    const Contour contour = window_contour(parameters, times[i]);
    const Index nodes = contour.nodes.size();
    ComplexVector weighted(nodes);
    for (Index p = 0; p < nodes; ++p) weighted[p] = contour.weights[p] * transfer(contour.nodes[p]);
    for (; i < times.size() && times[i] <= contour.t1; ++i) {
      double sum = 0;
      for (Index p = 0; p < nodes; ++p) sum += (weighted[p] * std::exp(times[i] * contour.nodes[p])).real();
      values[i] = sum;
    }
  }
  return values;
}

Vector logarithmic(double from, double to, Index count) {
  Vector grid(count);
  for (Index i = 0; i < count; ++i)
    grid[i] = from * std::pow(to / from, double(i) / double(std::max<Index>(count - 1, 1)));
  grid[count - 1] = to;
  return grid;
}

Matrix exponentials(const Vector& times, const Vector& rates) {
  return (times * rates.transpose()).array().exp().matrix();
}

struct Pivots {
  std::vector<Index> order;
  std::vector<double> left;  ///< largest norm of a column's part outside the span of those picked before
};

// Pivot order of the first `count` columns by modified Gram-Schmidt with column pivoting.
Pivots pivots(Matrix columns, Index count) {
  Pivots found;
  Vector norms = columns.colwise().squaredNorm().transpose();
  for (Index k = 0; k < count; ++k) {
    Index best = 0;
    const double most = norms.maxCoeff(&best);
    if (most <= 0) break;
    found.order.push_back(best);
    found.left.push_back(std::sqrt(most));
    const Vector q = columns.col(best).normalized();
    columns.noalias() -= q * (q.transpose() * columns).eval();
    columns.col(best).setZero();
    norms = columns.colwise().squaredNorm().transpose();
  }
  return found;
}

}  // namespace

ExponentialSum compress_line_kernel(const KroneckerDynamics& dynamics, double h, double T, double tolerance) {
  const auto parameters = contour_parameters(0);
  const Vector nu = dynamics.across.eigenvalues();
  const double span = std::max(T / h, 2.0);
  // Rates faster than 37/h are below rounding at the first sample; the two ends of the spectrum bound the rest.
  const double fastest = std::min(-nu.minCoeff(), 37 / h), slowest = std::min(-nu.maxCoeff(), fastest);
  const Index samples = 40 + Index(14 * std::log(span)), candidates = 24 + Index(12 * std::log(fastest / slowest));
  Vector rates = dynamics.across.points <= candidates ? nu : Vector(-logarithmic(slowest, fastest, candidates));
  const Vector times = logarithmic(h, std::max(T, 2 * h), samples);
  Vector checks(samples - 1);
  for (Index i = 0; i + 1 < samples; ++i) checks[i] = std::sqrt(times[i] * times[i + 1]);
  const Vector values = line_kernel(dynamics, *parameters, times),
               check_values = line_kernel(dynamics, *parameters, checks);
  const double scale = std::max(values.cwiseAbs().maxCoeff(), 1e-300);

  const Matrix all = exponentials(times, rates);
  const auto [order, left] = pivots(all, std::min<Index>({rates.size(), samples, 64}));
  ExponentialSum best;
  best.error = INFINITY;
  if (order.empty()) return best;  // nothing is left of the kernel at t = h
  // As long as some exponential is missed by 1e6 times the tolerance, so is their sum: no fit is tried.
  Index fewest = std::min<Index>(8, Index(order.size()));
  while (fewest + 2 <= Index(order.size()) && left[std::size_t(fewest)] > 1e6 * tolerance * left[0]) fewest += 2;
  for (Index K = fewest; K <= Index(order.size()); K += 2) {
    Vector chosen(K);
    for (Index k = 0; k < K; ++k) chosen[k] = rates[order[std::size_t(k)]];
    const Vector c = exponentials(times, chosen).colPivHouseholderQr().solve(values);
    const double error = (exponentials(checks, chosen) * c - check_values).cwiseAbs().maxCoeff() / scale;
    if (error < best.error) best = {chosen, c, error};
    if (best.error <= tolerance) break;
  }
  return best;
}

ModalRecurrence compressed_recurrence(Backend& backend, const KroneckerDynamics& dynamics, const ExponentialSum& sum,
                                      double h) {
  const Index n = dynamics.along.points, K = sum.rates.size();
  const Vector mu = dynamics.along.eigenvalues();
  ModalRecurrence r;
  r.decay.resize(K, n);
  r.output.resize(K, n);
  r.start.resize(K, n);
  for (Index k = 0; k < K; ++k) {
    for (Index l = 0; l < n; ++l) {
      const double x = h * (sum.rates[k] + mu[l]), growth = std::expm1(x), p1 = growth / x;
      r.decay(k, l) = growth + 1;
      r.output(k, l) = h * sum.coefficients[k] * p1 * p1;
      r.start(k, l) = (p1 - phi2(x)) / (p1 * p1);
    }
  }
  const LagTable near = contour_lag_table(backend, dynamics, *contour_parameters(0), h, 1);
  r.w0 = near.W.row(0).transpose();
  r.w1 = near.W.row(1).transpose() - r.output.colwise().sum().transpose();
  r.s1 = near.S.row(1).transpose() - r.output.cwiseProduct(r.start).colwise().sum().transpose();
  return r;
}

}  // namespace bromwich
