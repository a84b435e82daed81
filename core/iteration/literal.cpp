#include "core/iteration/literal.hpp"

#include "core/base/timer.hpp"
#include "core/lcp/active_set.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr double largest_half_angle = std::numbers::pi / 2 - 0.794;  ///< gamma < pi/2 - alpha, Theorem 2.2

// One time point: R(z_p) for all nodes and the weights of y_0..y_j in the inner integrals.
class TimePoint {
 public:
  TimePoint(Backend& backend, const Dynamics& dynamics, Index P, Index j, double h)
      : contour_(literal_contour(P, double(j) * h)), R_(backend.resolvent(dynamics, contour_.nodes)), j_(j), h_(h) {}

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
  LiteralKernel(const DiscreteProblem& p, const Dynamics& dynamics, Index P)
      : backend_(p.backend), modal_(p.modes() != nullptr), n_(p.scene.constraints()) {
    points_.reserve(std::size_t(p.J));
    for (Index j = 1; j <= p.J; ++j) points_.emplace_back(backend_, dynamics, P, j, p.h);
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
    return points_.empty() ? 0 : points_.size() * sizeof(Complex) * std::size_t(points_[0].resolvent().size());
  }

 private:
  Backend& backend_;
  bool modal_;
  Index n_;
  std::vector<TimePoint> points_;
  FaceTransforms face_;
  std::unique_ptr<Array> modes_, result_;
};

// g + N e^{A t_j} x0 (computed accurately, as the paper assumes) + the literal response to f.
RowMatrix literal_response(const DiscreteProblem& p, const LiteralKernel& kernel, Index P) {
  const Index rows = p.J + 1, n = p.scene.constraints();
  const auto in = p.backend.array(rows, n), out = p.backend.array(rows, n);
  RowMatrix r = p.g.table(), part;
  if (p.modes()) {
    p.backend.upload(kronecker_initial_response(p), *in);
    p.backend.face_transform(p.face(), rows, Way::to_points)->apply(*in, nullptr, *out, 0);
    p.backend.download(*out, part);
    r += part;
  } else {
    const DenseDynamics& d = *p.small_state();
    r += dense_states(step_operators(d.A, Rule::exponential, p.h), p.scene.x0, RowMatrix::Zero(rows, p.scene.states()),
                      p.defects.get()) *
         d.N.transpose();
  }
  if (p.rough_response) r += *p.rough_response;
  if (const SampledSource* phi = p.drive()) {
    upload(p.backend, *phi, *in);
    kernel.apply(*in, *out);
    p.backend.download(*out, part);
    r += part;
  } else if (p.f.size() > 0) {
    DenseDynamics source = *p.small_state();
    source.B = source_matrix(p);
    r += LiteralKernel(p, source, P).respond(p.f.table());
  }
  return r;
}

// e^{-2.06 sqrt P}/sqrt P, (2.8).
double printed_rate(Index P) { return std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P)); }

// The response of dense dynamics to y = 1 at the first, middle and last time point against phi1, relative to
// t ||N|| ||B||. NaN for a Kronecker sum: its A is normal with real spectrum, where Theorem 2.3 (2) holds.
double kernel_error(const DiscreteProblem& p, Index P) {
  const DenseDynamics* d = p.small_state();
  if (!d) return NAN;
  double worst = 0;
  for (const Index j : {Index(1), (p.J + 1) / 2, p.J}) {
    const double t = p.t[j];
    const Contour contour = literal_contour(P, t);
    const ComplexMatrix R = p.backend.resolvent(p.scene.dynamics, contour.nodes);
    const Matrix exact = t * d->N * matrix_phi(t * d->A).phi1 * d->B;
    const double scale = std::max(t * d->N.norm() * d->B.norm(), 1e-300);
    for (Index i = 0; i < exact.rows(); ++i)
      for (Index k = 0; k < exact.cols(); ++k) {
        Complex sum = 0;
        for (Index q = 0; q <= P; ++q)
          sum += contour.weights[q] * t * phi1(contour.nodes[q] * t) * R(q, i * exact.cols() + k);
        worst = std::max(worst, std::abs(sum.real() - exact(i, k)) / scale);
      }
  }
  return worst;
}

}  // namespace

void solve_literally(const DiscreteProblem& p, const Options& options, Result& result) {
  Timer timer;
  const Spectrum where = p.shared->spectrum();
  if (where.half_angle >= largest_half_angle) {
    result.status = Status::unsupported;
    result.reason = "contour-literal needs a spectrum in a sector of half-angle below 44.5 degrees; this one is " +
                    where.describe() + "; use another method";
    return;
  }
  const Index rows = p.J + 1, n = p.scene.constraints(), P = options.tuning.literal_nodes;
  const LiteralKernel kernel(p, p.scene.dynamics, P);
  const auto y = p.backend.array(rows, n), v = p.backend.array(rows, n), r = p.backend.array(rows, n);
  p.backend.upload(literal_response(p, kernel, P), *r);
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, rows);
  result.kernel = "a contour of " + std::to_string(P + 1) + " nodes for every time point";
  result.kernel_error = kernel_error(p, P);
  if (p.small_state() && !(result.kernel_error <= 100 * printed_rate(P))) {
    result.status = Status::unsupported;
    result.reason = "its contours have an error of " + std::to_string(result.kernel_error) +
                    " in K, far above the printed rate: A is too far from normal (2.1b); use another method";
    return;
  }
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
