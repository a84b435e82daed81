#include "core/kernel/transfer_fit.hpp"

#include "core/dynamics/line_transfer.hpp"
#include "core/numerics/orthogonal_factor.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index angles = 90, far_angles = 24, line_points = 48;  ///< of the samples
constexpr Index most_rates = 72;
constexpr double rates_per_fold = 9;     ///< candidates for a factor of e
constexpr double dependent = 3e-15;      ///< part of a column of norm 1 outside the span of those picked before
constexpr double smallest_angle = 0.02;  ///< times h/T: below it a rule on [0, T] does not resolve z

// h z of the rule at zeta = e^{i angle}, in the upper half-plane.
void add_points(const FitRegion& region, double angle, double shift, std::vector<Complex>& points) {
  // 1 - e^{i angle} without cancellation, conjugated into the upper half-plane.
  const double half = std::sin(angle / 2);
  const Complex small(2 * half * half, std::sin(angle));
  if (!region.radau) return points.push_back(small / region.h + shift);
  const Complex zeta = 1.0 - small, b = 2.0 + zeta, root = std::sqrt(b * b - 6.0 * small);
  const Complex plus = b + root, minus = b - root, large = std::abs(plus) > std::abs(minus) ? plus : minus;
  points.push_back(large / region.h + shift);
  points.push_back(6.0 * small / large / region.h + shift);
}

double log_between(double from, double to, double part) { return from * std::pow(to / from, part); }

// The boundary of the region: the curve of the rule moved by the two extreme shifts, and the line above both. Relative
// errors are analytic between them, as the functions have no zeros there, so that they are largest here.
std::vector<Complex> points_of(const FitRegion& region, double offset) {
  std::vector<Complex> points;
  const double slow = std::max(region.slowest_shift, 0.0), fast = std::max(region.fastest_shift, slow);
  const auto part = [offset](Index i, Index count) { return std::min((double(i) + offset) / double(count - 1), 1.0); };
  const double from = smallest_angle * region.h / region.T;
  const auto some = [&region](Index count) { return std::max<Index>(4, Index(double(count) * region.density)); };
  for (const auto& [shift, of_full] : {std::pair(slow, angles), std::pair(fast, far_angles)}) {
    if (of_full == far_angles && fast == slow) continue;
    const Index count = some(of_full);
    for (Index a = 0; a < count; ++a)
      add_points(region, log_between(from, std::numbers::pi, part(a, count)), shift, points);
  }
  double top = 0, right = 0;
  for (const Complex& z : points) top = std::max(top, z.imag());
  for (const Complex& z : points)
    if (z.imag() > 0.9 * top) right = std::max(right, z.real());
  if (fast == slow) return points;
  for (Index i = 0; i < some(line_points); ++i)
    points.emplace_back(
        log_between(slow + 0.5 / region.h, std::max(right, slow + 1 / region.h), part(i, some(line_points))), top);
  return points;
}

// Rows: real and imaginary parts at all points, each divided by `size`. Columns: the poles, then 1 and z if `grows`.
Matrix pole_basis(const std::vector<Complex>& points, const Vector& size, const Vector& rates, bool grows,
                  double unit) {
  const Index rows = Index(points.size()), K = rates.size();
  Matrix columns(2 * rows, K + (grows ? 2 : 0));
  for (Index i = 0; i < rows; ++i) {
    const Complex z = points[std::size_t(i)];
    for (Index k = 0; k < K; ++k) {
      const Complex value = (unit + std::abs(rates[k])) / (z - rates[k]) / size[i];
      columns(i, k) = value.real();
      columns(rows + i, k) = value.imag();
    }
    if (!grows) continue;
    columns(i, K) = 1 / size[i];
    columns(rows + i, K) = 0;
    columns(i, K + 1) = z.real() / unit / size[i];
    columns(rows + i, K + 1) = z.imag() / unit / size[i];
  }
  return columns;
}

struct Sampled {
  std::vector<Complex> points;
  Vector size;    ///< of the largest function at each point
  Matrix values;  ///< like the rows of `pole_basis`, one column for each function
};

Sampled sample_functions(const TransferFunctions& f, Index functions, std::vector<Complex> points) {
  const Index rows = Index(points.size());
  Sampled s{std::move(points), Vector(rows), Matrix(2 * rows, functions)};
  for (Index i = 0; i < rows; ++i) {
    const ComplexVector value = f(s.points[std::size_t(i)]);
    s.size[i] = std::max(value.cwiseAbs().maxCoeff(), 1e-300);
    s.values.row(i) = value.real().transpose() / s.size[i];
    s.values.row(rows + i) = value.imag().transpose() / s.size[i];
  }
  return s;
}

// Candidate rates in the order of a column-pivoted Gram-Schmidt; columns of `fixed` are removed first.
std::vector<Index> picked_rates(Matrix columns, const Matrix& fixed, Index count) {
  const auto remove = [&columns](const Vector& q) { columns.noalias() -= q * (q.transpose() * columns).eval(); };
  if (fixed.cols() > 0) {
    const Matrix q = orthogonal_columns(Eigen::HouseholderQR<Matrix>(fixed).householderQ(), fixed.cols());
    for (Index k = 0; k < q.cols(); ++k) remove(q.col(k));
  }
  std::vector<Index> order;
  for (Index k = 0; k < count; ++k) {
    Index best = 0;
    const double most = std::sqrt(columns.colwise().squaredNorm().maxCoeff(&best));
    if (!(most > dependent)) break;
    order.push_back(best);
    remove(Vector(columns.col(best) / most));
    columns.col(best).setZero();
  }
  return order;
}

double largest_error(const Eigen::Ref<const Matrix>& columns, const Matrix& c, const Matrix& values) {
  const Matrix error = columns * c - values;
  const Index rows = error.rows() / 2;
  return (error.topRows(rows).array().square() + error.bottomRows(rows).array().square()).sqrt().maxCoeff();
}

}  // namespace

PoleSum fit_poles(const TransferFunctions& f, Index functions, const FitRegion& region, double slowest, double fastest,
                  bool grows, double tolerance) {
  const Index candidates = 24 + Index(rates_per_fold * std::log(fastest / slowest));
  Vector rates(candidates);
  for (Index k = 0; k < candidates; ++k) rates[k] = -log_between(slowest, fastest, double(k) / double(candidates - 1));
  const Sampled fitted = sample_functions(f, functions, points_of(region, 0)),
                checked = sample_functions(f, functions, points_of(region, 0.43));
  PoleSum best{{}, {}, Vector::Zero(functions), Vector::Zero(functions), INFINITY};
  if (!fitted.values.allFinite() || !checked.values.allFinite()) return best;
  const double unit = 1 / region.h + region.fastest_shift;
  const Index extra = grows ? 2 : 0;
  Matrix all = pole_basis(fitted.points, fitted.size, rates, grows, unit);
  const Vector norms = all.colwise().norm().transpose();
  all = (all * norms.cwiseInverse().asDiagonal()).eval();
  const std::vector<Index> order = picked_rates(all.leftCols(candidates), all.rightCols(extra), most_rates);
  // 1 and z first, then the poles in their order: the leading part of one triangle serves every number of poles.
  const Index most = Index(order.size());
  const Vector picked = rates(order);
  Matrix columns(all.rows(), extra + most);
  columns << all.rightCols(extra), all(Eigen::all, order);
  const Matrix at_checks = pole_basis(checked.points, checked.size, picked, grows, unit);
  Matrix check_columns(at_checks.rows(), extra + most);
  check_columns << at_checks.rightCols(extra), at_checks.leftCols(most);
  Vector size(extra + most);
  size << norms.tail(extra), norms(order);
  const Eigen::HouseholderQR<Matrix> qr(columns);
  const Matrix projected = orthogonal_columns(qr.householderQ(), extra + most).transpose() * fitted.values;
  for (Index K = std::min<Index>(8, most); K <= most; K += 2) {
    const Index used = extra + K;
    const Matrix scaled =
        qr.matrixQR().topLeftCorner(used, used).triangularView<Eigen::Upper>().solve(Matrix(projected.topRows(used)));
    const Matrix c = size.head(used).cwiseInverse().asDiagonal() * scaled;
    const double error = std::max(largest_error(check_columns.leftCols(used), c, checked.values),
                                  largest_error(columns.leftCols(used), scaled, fitted.values));
    if (error < 0.7 * best.error) {
      best.rates = picked.head(K);
      best.coefficients = (unit + best.rates.array().abs()).matrix().asDiagonal() * c.bottomRows(K);
      if (grows) {
        best.constant = c.row(0).transpose();
        best.linear = c.row(1).transpose() / unit;
      }
      best.error = error;
    }
    if (error <= tolerance) break;
  }
  return best;
}

PoleSum fit_line(const KroneckerDynamics& d, bool radau, double h, double T) {
  std::vector<LineTransfer> lines;
  for (Index f = 0; f < d.families(); ++f) lines.emplace_back(d.across, d.n, d.input(f));
  const TransferFunctions transfer = [&lines](Complex z) -> ComplexVector {
    ComplexVector values(Index(lines.size()));
    for (Index f = 0; f < values.size(); ++f) values[f] = lines[std::size_t(f)](z);
    return values;
  };
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  return fit_poles(transfer, d.families(), {radau, h, T, -mu.maxCoeff(), -mu.minCoeff()}, -nu.maxCoeff(),
                   -nu.minCoeff(), false);
}

}  // namespace bromwich
