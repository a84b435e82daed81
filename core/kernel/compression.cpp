#include "core/kernel/compression.hpp"

#include "core/kernel/response.hpp"
#include "core/numerics/orthogonal_factor.hpp"
#include "core/numerics/phi.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace bromwich {

namespace {

// k(t) = n^T e^{across t} b of one family at ascending times, with one contour per window of ratio 5.
Vector line_kernel(const KroneckerDynamics& d, Index family, const ContourParameters& parameters, const Vector& times) {
  const LineTransfer transfer(d.across, d.n, d.input(family));
  Vector values(times.size());
  for (Index i = 0; i < times.size();) {
    const Contour contour = window_contour(parameters, times[i]);
    const Index nodes = contour.nodes.size();
    ComplexVector weighted(nodes);
    for (Index p = 0; p < nodes; ++p) weighted[p] = contour.weights[p] * transfer(contour.nodes[p]);
    for (; i < times.size() && times[i] <= contour.t1; ++i) {
      const Eigen::ArrayXd size = (times[i] * contour.nodes.real().array()).exp();
      double sum = 0;  // of Re(w e^{zt})
      for (Index p = 0; p < nodes; ++p) {
        const Complex direction = std::polar(1.0, times[i] * contour.nodes[p].imag());
        sum += size[p] * (weighted[p].real() * direction.real() - weighted[p].imag() * direction.imag());
      }
      values[i] = sum;
    }
  }
  return values;
}

Matrix line_kernels(const KroneckerDynamics& d, const ContourParameters& parameters, const Vector& times) {
  Matrix values(times.size(), d.families());
  for (Index f = 0; f < d.families(); ++f) values.col(f) = line_kernel(d, f, parameters, times);
  return values;
}

/// Once the fit is good enough, each further rate has to reduce the error by this factor: it costs time in every sweep,
/// and a smaller gain may be rounding.
constexpr double gain_of_a_rate = 1.19;
constexpr Index columns_together = 64;  ///< of products, per thread
constexpr Index modes_together = 2048;  ///< of a recurrence, per thread
constexpr Index parts_of_lines = 16;    ///< of x0, a thread each
constexpr double between_samples = 4;   ///< how much larger errors may be than at the check points

Vector logarithmic(double from, double to, Index count) {
  Vector grid(count);
  for (Index i = 0; i < count; ++i)
    grid[i] = from * std::pow(to / from, double(i) / double(std::max<Index>(count - 1, 1)));
  grid[count - 1] = to;
  return grid;
}

// Sample times of the fit on [h, T], and check times between them.
struct SampleTimes {
  Vector fitted, checked;
};

SampleTimes sample_times(double h, double T) {
  const double end = std::max(T, 2 * h);
  const Index samples = 40 + Index(14 * std::log(end / h));
  const Vector fitted = logarithmic(h, end, samples);
  return {fitted, (fitted.head(samples - 1).array() * fitted.tail(samples - 1).array()).sqrt()};
}

// 0 where squares and products would be denormal, which are slow.
Matrix exponentials(const Vector& times, const Vector& rates) {
  constexpr double least = -340;
  const Matrix x = times * rates.transpose();
  return (x.array() < least).select(0, x.array().exp());
}

struct Pivots {
  std::vector<Index> order;
  std::vector<double> left;  ///< largest norm of a column's part outside the span of the columns picked before
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
    columns.col(best).setZero();
    const Eigen::RowVectorXd parts = q.transpose() * columns;
    columns.noalias() -= q * parts;
    norms = columns.colwise().squaredNorm().transpose();
  }
  return found;
}

/// x0 as all faces see it. One face sees x0 itself, of which no copy is made.
struct Views {
  Views(const KroneckerDynamics& d, const Vector& x0)
      : both(d.both_faces ? d.views(x0) : Vector()), of_all(d.both_faces ? both : x0) {}

  const Vector both;
  const Vector& of_all;
};

// 2-norms over all lines X of x0 of their components in the eigenvectors V of a line: roots of the diagonal of
// V^T (X^T X) V. To eps of the largest one, as they weigh small errors.
Vector sizes_in_line_modes(Backend& backend, const KroneckerDynamics& d, const Vector& x0) {
  const Views views(d, x0);
  const Eigen::Map<const RowMatrix> X(views.of_all.data(), d.face_points(), d.across.points);
  const Index together = (X.rows() + parts_of_lines - 1) / parts_of_lines, parts = (X.rows() + together - 1) / together;
  std::vector<Matrix> squares(std::size_t(parts), Matrix::Zero(X.cols(), X.cols()));
  backend.each_range(X.rows(), together, [&](Index first, Index last) {
    squares[std::size_t(first / together)].selfadjointView<Eigen::Lower>().rankUpdate(
        X.middleRows(first, last - first).transpose());
  });
  for (Index i = 1; i < parts; ++i) squares[0] += squares[std::size_t(i)];
  const RowMatrix square = squares[0].selfadjointView<Eigen::Lower>();
  const RowMatrix once = in_line_modes(backend, d.across, square).transpose();
  return in_line_modes(backend, d.across, once).diagonal().cwiseMax(0).cwiseSqrt();
}

}  // namespace

ExponentialSum compress_line_kernel(const KroneckerDynamics& dynamics, double h, double T, double tolerance) {
  const auto parameters = contour_parameters(0);
  const Vector nu = dynamics.across.eigenvalues();
  // Rates faster than 37/h are below rounding at the first sample; the two ends of the spectrum bound the rest.
  const double fastest = std::min(-nu.minCoeff(), 37 / h), slowest = std::min(-nu.maxCoeff(), fastest);
  const Index candidates = 24 + Index(12 * std::log(fastest / slowest));
  Vector rates = dynamics.across.points <= candidates ? nu : Vector(-logarithmic(slowest, fastest, candidates));
  const auto [times, checks] = sample_times(h, T);
  const Matrix values = line_kernels(dynamics, *parameters, times),
               check_values = line_kernels(dynamics, *parameters, checks);
  const double scale = std::max(values.cwiseAbs().maxCoeff(), 1e-300);

  const Matrix all = exponentials(times, rates);
  const auto [order, left] = pivots(all, std::min<Index>({rates.size(), times.size(), 64}));
  ExponentialSum best;
  best.error = INFINITY;
  if (order.empty()) return best;  // the kernel has decayed at t = h
  // While some exponential is missed by 1e6 times the tolerance, so is the sum: skip these fits.
  Index fewest = std::min<Index>(8, Index(order.size()));
  while (fewest + 2 <= Index(order.size()) && left[std::size_t(fewest)] > 1e6 * tolerance * left[0]) fewest += 2;
  // One factorization serves all numbers of rates: the first K columns of Q R are those of the first K rates.
  const Vector picked = rates(order);
  const Eigen::HouseholderQR<Matrix> qr(all(Eigen::all, order));
  const Matrix projected = qr.householderQ().adjoint() * values;
  const Matrix check = exponentials(checks, picked);
  for (Index K = fewest; K <= picked.size(); K += 2) {
    const Matrix c = qr.matrixQR().topLeftCorner(K, K).triangularView<Eigen::Upper>().solve(projected.topRows(K));
    const double error = (check.leftCols(K) * c - check_values).cwiseAbs().maxCoeff() / scale;
    const bool good = best.error <= accepted_compression_error;
    const double pays = good ? std::pow(gain_of_a_rate, double(best.rates.size() - K)) : 1;
    if (error < pays * best.error) best = {picked.head(K), c, error};
    if (error <= tolerance) break;
  }
  return best;
}

InitialFit fit_initial_response(Backend& backend, const KroneckerDynamics& dynamics, const ExponentialSum& sum,
                                double h, double T) {
  const Index K = dynamics.across.points, terms = sum.rates.size();
  const Vector nu = dynamics.across.eigenvalues();
  const SampleTimes times = sample_times(h, T);
  const Eigen::HouseholderQR<Matrix> qr(exponentials(times.fitted, sum.rates));
  const Matrix Q = orthogonal_columns(qr.householderQ(), terms);
  const auto R = qr.matrixQR().topRows(terms).triangularView<Eigen::Upper>();
  const Matrix check = exponentials(times.checked, sum.rates);
  InitialFit fit{Vector(K), dynamics.across.in_modes(dynamics.n), nullptr};
  Matrix C(terms, K);
  backend.each_range(K, columns_together, [&](Index first, Index last) {
    const Vector rates = nu.segment(first, last - first);
    Matrix part = Q.transpose() * exponentials(times.fitted, rates);
    R.solveInPlace(part);
    const Matrix gap = check * part - exponentials(times.checked, rates);
    fit.missed.segment(first, last - first) = gap.cwiseAbs().colwise().maxCoeff().transpose();
    C.middleCols(first, last - first) = part * fit.seen.segment(first, last - first).asDiagonal();
  });
  fit.project = std::make_shared<InitialProjection>(backend, dynamics, from_line_modes(backend, dynamics.across, C));
  return fit;
}

InitialProjection::InitialProjection(Backend& backend, const KroneckerDynamics& dynamics, const RowMatrix& P)
    : backend_(backend),
      dynamics_(dynamics),
      P_(backend.array(P.rows(), P.cols())),
      values_(backend.array(P.rows(), dynamics.face_points())),
      modes_(backend.array(P.rows(), dynamics.face_points())),
      to_modes_(backend.face_transform(dynamics.face_basis(), P.rows(), Way::to_modes)) {
  backend.upload(P, *P_);
}

const Array& InitialProjection::operator()(const Vector& x0) {
  backend_.upload_projection(Views(dynamics_, x0).of_all, *P_, *values_);
  to_modes_->apply(*values_, nullptr, *modes_, 0);
  return *modes_;
}

double initial_error(Backend& backend, const KroneckerDynamics& dynamics, const InitialFit& fit, const Vector& x0) {
  const double most = between_samples * fit.missed.maxCoeff();
  if (most <= accepted_compression_error) return most;
  const Vector parts = fit.seen.cwiseAbs().cwiseProduct(sizes_in_line_modes(backend, dynamics, x0));
  const double size = parts.sum();
  return size > 0 ? between_samples * parts.dot(fit.missed) / size : 0;
}

std::optional<RowMatrix> start_of(const ModalRecurrence& r, const RowMatrix& D, const HostThreads& threads) {
  RowMatrix initial(r.exponentials(), r.modes());
  std::atomic<bool> finite = true;
  threads.each_range(r.modes(), modes_together, [&](Index first, Index last) {
    const auto part = [&](const RowMatrix& table, Index k) {
      return table.row(k).segment(first, last - first).array();
    };
    for (Index k = 0; k < r.exponentials(); ++k) {
      auto to = initial.row(k).segment(first, last - first).array();
      to = (part(r.decay, k) == 0).select(0, part(D, k) * part(r.decay, k) / part(r.output, k));
      if ((0 * to).sum() != 0) finite = false;  // NaN is not 0 either
    }
  });
  if (!finite) return std::nullopt;
  return initial;
}

std::optional<ModalRecurrence> started(const ModalRecurrence& r, const RowMatrix& D, const HostThreads& threads) {
  auto initial = start_of(r, D, threads);
  if (!initial) return std::nullopt;
  ModalRecurrence with_x0;
  with_x0.face = r.face, with_x0.families = r.families;
  with_x0.w0 = r.w0, with_x0.w1 = r.w1, with_x0.s1 = r.s1;
  with_x0.initial = std::move(*initial);
  const auto copy = [&](const RowMatrix& from, RowMatrix& to) {
    to.resize(from.rows(), from.cols());
    threads.each_range(from.cols(), modes_together, [&](Index first, Index last) {
      to.middleCols(first, last - first) = from.middleCols(first, last - first);
    });
  };
  copy(r.decay, with_x0.decay), copy(r.output, with_x0.output), copy(r.start, with_x0.start);
  return with_x0;
}

ModalRecurrence compressed_recurrence(Backend& backend, const KroneckerDynamics& dynamics, const ExponentialSum& sum,
                                      double h) {
  const Index n = dynamics.face_points(), K = sum.rates.size(), lines = dynamics.lines();
  const Vector mu = dynamics.face_eigenvalues();
  ModalRecurrence r;
  r.face = dynamics.face_basis();
  r.families = dynamics.families();
  r.decay.resize(K, n);
  r.output.resize(K, n);
  r.start.resize(K, n);
  const LagTable near = contour_lag_table(backend, dynamics, *contour_parameters(0), h, 1);
  r.w0 = near.W.row(0).transpose();
  r.w1 = near.W.row(1).transpose();
  r.s1 = near.S.row(1).transpose();
  backend.each_range(n, modes_together, [&](Index first, Index last) {
    const Index count = last - first;
    Eigen::ArrayXd c(count);
    for (Index k = 0; k < K; ++k) {
      const auto [exponential, phi1, phi2] = array_phi(h * (mu.segment(first, count).array() + sum.rates[k]));
      for (Index i = 0; i < count; ++i) c[i] = h * sum.coefficients(k, (first + i) / lines);
      auto output = r.output.row(k).segment(first, count).array();
      auto start = r.start.row(k).segment(first, count).array();
      r.decay.row(k).segment(first, count) = exponential;
      output = c * phi1.square();
      start = (phi1 - phi2) / phi1.square();
      r.w1.segment(first, count).array() -= output.transpose();
      r.s1.segment(first, count).array() -= (output * start).transpose();
    }
  });
  return r;
}

}  // namespace bromwich
