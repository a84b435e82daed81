#include "core/kernel/kernel.hpp"

#include "core/base/text.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace bromwich {

namespace {

// F_d and S_d of one lag at x = h z.
Complex factor_W(Index d, Complex x, double h) {
  if (d == 0) return h * std::exp(x) / (x * x);
  if (d == 1) return h * (std::exp(2.0 * x) - 2.0 * std::exp(x)) / (x * x);
  const Complex p = phi1(x);
  return h * std::exp(double(d - 1) * x) * p * p;
}

Complex factor_S(Index d, Complex x, double h) {
  if (d == 0) return 0;
  if (d == 1) return h * std::exp(x) * (x - 1.0) / (x * x);
  return h * std::exp(double(d - 1) * x) * (phi1(x) - phi2(x));
}

// Length of a run of repeated multiplications: its relative error stays below about geometric_run eps.
constexpr Index geometric_run = 16;

constexpr Index columns_together = 2048;  ///< of a product, per thread

}  // namespace

LagWindow lag_window(const Contour& contour, double h, Index first, Index last) {
  LagWindow window{first, last, contour, {}, {}};
  const Index lags = last - first + 1, nodes = window.contour.nodes.size();
  window.F.resize(lags, nodes);
  window.S.resize(lags, nodes);
  for (Index p = 0; p < nodes; ++p) {
    const Complex x = h * window.contour.nodes[p], c = window.contour.weights[p];
    const Complex step = std::exp(x);
    for (Index d = first; d <= last; ++d) {
      const Index row = d - first;
      // From lag 2 on, a window is a geometric sequence: one multiplication per lag, restarted before rounding adds up.
      if (d >= 3 && row % geometric_run != 0) {
        window.F(row, p) = step * window.F(row - 1, p);
        window.S(row, p) = step * window.S(row - 1, p);
      } else {
        window.F(row, p) = c * factor_W(d, x, h);
        window.S(row, p) = c * factor_S(d, x, h);
      }
    }
  }
  return window;
}

ComplexMatrix exponential_factors(const Contour& contour, double h, Index first, Index last) {
  ComplexMatrix F(last - first + 1, contour.nodes.size());
  for (Index p = 0; p < F.cols(); ++p) {
    const Complex step = std::exp(h * contour.nodes[p]);
    for (Index j = 0; j < F.rows(); ++j)
      F(j, p) = j % geometric_run != 0 ? step * F(j - 1, p)
                                       : contour.weights[p] * std::exp(double(first + j) * h * contour.nodes[p]);
  }
  return F;
}

// Re(F R) by two real products, half the multiplications of a complex product.
void real_product(const ComplexMatrix& F, const ComplexMatrix& R, Eigen::Ref<RowMatrix> out) {
  const Matrix Fr = F.real(), Fi = F.imag();
  const RowMatrix Rr = R.real(), Ri = R.imag();
  out.noalias() = Fr * Rr;
  out.noalias() -= Fi * Ri;
}

std::vector<LagWindow> lag_windows(const ContourParameters& parameters, double h, Index J, double shift) {
  std::vector<LagWindow> windows;
  for (Index first = 0; first <= J;) {
    const Index last = std::min<Index>(J, first == 0 ? 1 : Index(window_ratio) * (first - 1) - 1);
    Contour contour = first == 0 ? near_contour(parameters, h) : window_contour(parameters, h * double(first - 1));
    contour.nodes.array() += shift;
    windows.push_back(lag_window(contour, h, first, last));
    first = last + 1;
  }
  return windows;
}

std::vector<LagWindow> shared_lag_windows(const ContourParameters& parameters, double h, Index J, double shift,
                                          double common) {
  constexpr double rounding = 1e-9;
  double start = common;  // 4^k common in (h, 4h]
  while (start > 4 * h * (1 + rounding)) start /= 4;
  while (start <= h * (1 + rounding)) start *= 4;
  // The lags that each window can take, in [start + h, ratio start - h], have to reach the next one.
  for (double q = start / h; q * h < 4 * h * double(J); q *= 4)
    if (std::floor(window_ratio * q * (1 + rounding)) - 1 < 4 * q * (1 - rounding))
      return lag_windows(parameters, h, J, shift);
  std::vector<LagWindow> windows;
  const auto add = [&](Contour contour, Index first, Index last) {
    contour.nodes.array() += shift;
    windows.push_back(lag_window(contour, h, first, std::min(last, J)));
  };
  add(near_contour(parameters, h), 0, 1);
  if (J > 1) add(window_contour(parameters, h), 2, Index(window_ratio) - 1);
  for (Index first = Index(window_ratio); first <= J; start *= 4) {
    const Index last = Index(std::floor(window_ratio * start / h * (1 + rounding))) - 1;
    add(window_contour(parameters, start), first, last);
    first = last + 1;
  }
  return windows;
}

LagTable contour_lag_table(Backend& backend, const Dynamics& dynamics, const ContourParameters& parameters, double h,
                           Index J) {
  LagTable table;
  table.modal = dynamics->modes() != nullptr;
  table.outputs = table.inputs = constraints(dynamics);
  if (table.modal) table.face = dynamics->modes()->face_basis();
  const Index width = table.modal ? table.outputs : table.outputs * table.inputs;
  table.W.resize(J + 1, width);
  table.S.resize(J + 1, width);
  for (const LagWindow& window : lag_windows(parameters, h, J)) {
    const ComplexMatrix R = backend.resolvent(dynamics, window.contour.nodes);
    const Index count = window.last - window.first + 1;
    backend.each_range(width, columns_together, [&](Index first, Index last) {
      const auto part = [&](RowMatrix& to) { return to.block(window.first, first, count, last - first); };
      const ComplexMatrix of_part = R.middleCols(first, last - first);
      real_product(window.F, of_part, part(table.W));
      real_product(window.S, of_part, part(table.S));
    });
  }
  table.S.row(0).setZero();
  return table;
}

RowMatrix contour_initial_response(const KroneckerDynamics& dynamics, const ContourParameters& parameters,
                                   const RowMatrix& x0_lines, double h, Index J) {
  const Index n = dynamics.face_points();
  const Vector mu = dynamics.face_eigenvalues();
  RowMatrix response(J + 1, n);
  response.row(0) = (x0_lines * dynamics.n).transpose();
  for (Index first = 1; first <= J;) {
    const Contour contour = window_contour(parameters, h * double(first));
    const Index last = std::min<Index>(J, Index(window_ratio) * first);
    const Index nodes = contour.nodes.size(), count = last - first + 1;
    ComplexMatrix rows(nodes, dynamics.across.points);
    for (Index p = 0; p < nodes; ++p)
      rows.row(p) = green_row(dynamics.across, dynamics.n, contour.nodes[p]).transpose();
    ComplexMatrix R(nodes, n);
    const Matrix lines = x0_lines.transpose();
    const Matrix real = rows.real(), imag = rows.imag();
    R.real() = real * lines;
    R.imag() = imag * lines;
    real_product(exponential_factors(contour, h, first, last), R, response.middleRows(first, count));
    first = last + 1;
  }
  // Values below 1e-200 are set to zero: their products would be denormal.
  const Eigen::ArrayXd step = (h * mu.array()).exp();
  Eigen::ArrayXd power(n);
  for (Index j = 1; j <= J; ++j) {
    if (j % geometric_run == 1)
      power = (double(j) * h * mu.array()).max(-460).exp() * (double(j) * h * mu.array() > -460).cast<double>();
    else
      power *= step;
    response.row(j).array() *= power.transpose();
  }
  return response;
}

}  // namespace bromwich
