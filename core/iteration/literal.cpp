#include "core/iteration/literal.hpp"

#include "core/base/timer.hpp"
#include "core/kernel/kernel.hpp"
#include "core/lcp/active_set.hpp"
#include "core/numerics/literal_contour.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double largest_half_angle = std::numbers::pi / 2 - printed_gamma;  ///< gamma < pi/2 - alpha, Theorem 2.2
constexpr Index initial_nodes = 14;  ///< P of Remark 2.3, where e^{-2.32 P} meets eps e^{0.35 P}

// The contour of every time point: the printed one, or one around the eigenvalues of dense dynamics.
class Contours {
 public:
  Contours(const DiscreteProblem& p, Index P)
      : p_(p), P_(P), printed_(p.shared->spectrum().half_angle < largest_half_angle) {
    if (!printed_) take_eigenvalues();
  }

  void take_eigenvalues() {
    if (const DenseDynamics* d = p_.small_state())
      printed_ = false, eigenvalues_ = Eigen::EigenSolver<Matrix>(d->A, false).eigenvalues();
  }

  bool printed() const { return printed_; }
  bool any() const { return printed_ || eigenvalues_.size() > 0; }
  Contour at(double t) const { return printed_ ? literal_contour(P_, t) : contour_around(eigenvalues_, P_, t); }
  std::string describe() const {
    return "a contour of " + std::to_string(P_ + 1) + " nodes" +
           (printed_ ? "" : " around eigenvalues, and circles around the others,") + " for every time point";
  }

 private:
  const DiscreteProblem& p_;
  Index P_;
  bool printed_;
  ComplexVector eigenvalues_;
};

// One time point: R(z_p) for all nodes and the weights of y_0..y_j in the inner integrals.
class TimePoint {
 public:
  TimePoint(Backend& backend, const Dynamics& dynamics, Contour contour, Index j, double h)
      : contour_(std::move(contour)), R_(backend.resolvent(dynamics, contour_.nodes)), j_(j), h_(h) {}

  // Rows p: c_p times the weights of u_0, ..., u_j in ∫_0^{t_j} e^{z_p (t_j - s)} u(s) ds, u piecewise linear.
  ComplexMatrix weights() const {
    ComplexMatrix w(contour_.nodes.size(), j_ + 1);
    for (Index p = 0; p < w.rows(); ++p) {
      const Complex x = h_ * contour_.nodes[p], p1 = phi1(x), p2 = phi2(x), c = contour_.weights[p] * h_,
                    step = std::exp(x);
      w(p, j_) = c * p2;
      Complex power = c;
      for (Index l = j_ - 1; l >= 1; --l, power *= step) w(p, l) = power * p1 * p1;
      w(p, 0) = power * (p1 - p2);
    }
    return w;
  }

  const ComplexMatrix& resolvent() const { return R_; }

 private:
  Contour contour_;
  ComplexMatrix R_;
  Index j_;
  double h_;
};

class LiteralKernel {
 public:
  LiteralKernel(const DiscreteProblem& p, const Dynamics& dynamics, const Contours& contours)
      : backend_(p.backend), modal_(p.modes() != nullptr), n_(p.scene.constraints()) {
    points_.reserve(std::size_t(p.J));
    for (Index j = 1; j <= p.J; ++j) points_.emplace_back(backend_, dynamics, contours.at(double(j) * p.h), j, p.h);
    if (!modal_) return;
    face_ = backend_.face_transforms(p.face(), p.J + 1);
    modes_ = backend_.array(p.J + 1, n_);
    result_ = backend_.array(p.J + 1, n_);
  }

  // v_j for inputs u (constraints, or constraints and sources).
  RowMatrix respond(const RowMatrix& u) const {
    RowMatrix v = RowMatrix::Zero(u.rows(), n_);
    for (Index j = 1; j < u.rows(); ++j) {
      const TimePoint& point = points_[std::size_t(j - 1)];
      const ComplexMatrix integrals = point.weights() * u.topRows(j + 1).cast<Complex>();
      const ComplexMatrix& R = point.resolvent();
      if (modal_) {
        v.row(j) = R.cwiseProduct(integrals).colwise().sum().real();
        continue;
      }
      for (Index i = 0; i < n_; ++i)
        v(j, i) = R.middleCols(i * u.cols(), u.cols()).cwiseProduct(integrals).sum().real();
    }
    return v;
  }

  void apply(const Array& y, Array& v) const {
    RowMatrix u;
    if (!modal_) {
      backend_.download(y, u);
      backend_.upload(respond(u), v);
      return;
    }
    face_.to_modes->apply(y, nullptr, *modes_, 0);
    backend_.download(*modes_, u);
    backend_.upload(respond(u), *result_);
    face_.to_points->apply(*result_, nullptr, v, 0);
  }

  std::size_t bytes() const {
    std::size_t total = 0;
    for (const TimePoint& point : points_) total += sizeof(Complex) * std::size_t(point.resolvent().size());
    return total;
  }

 private:
  Backend& backend_;
  bool modal_;
  Index n_;
  std::vector<TimePoint> points_;
  FaceTransforms face_;
  std::unique_ptr<Array> modes_, result_;
};

// N e^{A t_j} x0, n in modes for a Kronecker sum: where the spectrum is real by the second contour of Remark 2.3, one
// for each time point, otherwise computed accurately, as the paper assumes.
RowMatrix initial_trace(const DiscreteProblem& p) {
  const Spectrum where = p.shared->spectrum();
  const bool real = where.real_negative() && !where.non_normal;
  const ContourParameters second = initial_value_parameters(initial_nodes);
  RowMatrix out(p.J + 1, p.scene.constraints());
  if (const KroneckerDynamics* d = p.modes()) {
    if (!real) return kronecker_initial_response(p);
    const RowMatrix lines = x0_in_modes(p.backend, *d, p.scene.x0, false);
    out.row(0) = contour_initial_response(*d, second, lines, p.h, 0).row(0);
    for (Index j = 1; j <= p.J; ++j) out.row(j) = contour_initial_response(*d, second, lines, p.t[j], 1).row(1);
    return out;
  }
  const DenseDynamics& d = *p.small_state();
  if (!real)
    return dense_states(step_operators(d.A, Rule::exponential, p.h), p.scene.x0, RowMatrix::Zero(p.J + 1, d.A.rows())) *
           d.N.transpose();
  DenseDynamics start = d;
  start.B = p.scene.x0;
  out.row(0) = d.N * p.scene.x0;
  for (Index j = 1; j <= p.J; ++j) {
    const Contour contour = window_contour(second, p.t[j]);
    const ComplexVector factors = contour.weights.array() * (p.t[j] * contour.nodes.array()).exp();
    out.row(j) = (factors.transpose() * p.backend.resolvent(start, contour.nodes)).real();
  }
  return out;
}

// g + N e^{A t_j} x0 + the literal response to f.
RowMatrix literal_response(const DiscreteProblem& p, const LiteralKernel& kernel, const Contours& contours) {
  const Index rows = p.J + 1, n = p.scene.constraints();
  const auto in = p.backend.array(rows, n), out = p.backend.array(rows, n);
  RowMatrix r = p.g.table(), part = initial_trace(p);
  if (p.modes()) {
    p.backend.upload(part, *in);
    p.backend.face_transform(p.face(), rows, Way::to_points)->apply(*in, nullptr, *out, 0);
    p.backend.download(*out, part);
  } else if (p.defects) {
    const DenseDynamics& d = *p.small_state();
    part += dense_states(step_operators(d.A, Rule::exponential, p.h), Vector::Zero(d.A.rows()),
                         RowMatrix::Zero(rows, d.A.rows()), p.defects.get()) *
            d.N.transpose();
  }
  r += part;
  if (p.rough_response) r += *p.rough_response;
  if (const SampledSource* phi = p.drive()) {
    upload(p.backend, *phi, *in);
    kernel.apply(*in, *out);
    p.backend.download(*out, part);
    r += part;
  } else if (p.f.size() > 0) {
    DenseDynamics source = *p.small_state();
    source.B = source_matrix(p);
    r += LiteralKernel(p, source, contours).respond(p.f.table());
  }
  return r;
}

// e^{-2.06 sqrt P}/sqrt P, (2.8).
double printed_rate(Index P) { return std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P)); }

// The response of dense dynamics to y = 1 at the first, middle and last time point against phi1, relative to
// t ||N|| ||B|| or to K where it grows. NaN for a Kronecker sum: its A is normal with real spectrum, where Theorem 2.3
// (2) holds.
double kernel_error(const DiscreteProblem& p, const Contours& contours) {
  const DenseDynamics* d = p.small_state();
  if (!d) return NAN;
  double worst = 0;
  for (const Index j : {Index(1), (p.J + 1) / 2, p.J}) {
    const double t = p.t[j];
    const Contour contour = contours.at(t);
    const ComplexMatrix R = p.backend.resolvent(p.scene.dynamics, contour.nodes);
    const Matrix exact = t * d->N * matrix_phi(t * d->A).phi1 * d->B;
    const double scale = std::max({t * d->N.norm() * d->B.norm(), exact.norm(), 1e-300});
    for (Index i = 0; i < exact.rows(); ++i)
      for (Index k = 0; k < exact.cols(); ++k) {
        Complex sum = 0;
        for (Index q = 0; q < contour.nodes.size(); ++q)
          sum += contour.weights[q] * t * phi1(contour.nodes[q] * t) * R(q, i * exact.cols() + k);
        worst = std::max(worst, std::abs(sum.real() - exact(i, k)) / scale);
      }
  }
  return worst;
}

}  // namespace

void solve_literally(const DiscreteProblem& p, const Options& options, Result& result) {
  Timer timer;
  const Index rows = p.J + 1, n = p.scene.constraints(), P = options.tuning.literal_nodes;
  Contours contours(p, P);
  if (!contours.any()) {
    result.status = Status::unsupported;
    result.reason =
        "contour-literal needs a spectrum in a sector of half-angle below 44.5 degrees, or dense dynamics; this one "
        "is " +
        p.shared->spectrum().describe() + "; use another method";
    return;
  }
  const auto missed = [&] {
    result.kernel_error = kernel_error(p, contours);
    return p.small_state() && !(result.kernel_error <= 100 * printed_rate(P));
  };
  // Where (2.1b) does not hold, as for a zero eigenvalue without eigenvectors, the printed contour is too near.
  if (missed() && contours.printed()) contours.take_eigenvalues();
  if (missed()) {
    result.status = Status::unsupported;
    result.reason = "its contours have an error of " + std::to_string(result.kernel_error) +
                    " in K, far above the printed rate: A is too far from normal (2.1b); use another method";
    return;
  }
  result.kernel = contours.describe();
  const LiteralKernel kernel(p, p.scene.dynamics, contours);
  const auto y = p.backend.array(rows, n), v = p.backend.array(rows, n), r = p.backend.array(rows, n);
  p.backend.upload(literal_response(p, kernel, contours), *r);
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, rows);
  result.bytes = y->bytes() * 3 + kernel.bytes() + lcp->bytes() + host_bytes(p);
  result.seconds.setup += timer.lap();

  double convolution = 0;
  const ApplyKernel apply = [&](const Array& in, Array& out, Index) {
    Timer lap;
    kernel.apply(in, out);
    convolution += lap.lap();
  };
  const IterationOutcome outcome = iterate(p, options, apply, false, *lcp, *r, *y, *v, result);
  finish_iteration(p, options, outcome, apply, *lcp, *r, *y, *v, result);
  result.seconds.convolution = convolution;
}

}  // namespace bromwich
