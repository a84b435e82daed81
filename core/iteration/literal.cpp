#include "core/iteration/literal.hpp"

#include "core/base/interruption.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/kernel.hpp"
#include "core/lcp/active_set.hpp"
#include "core/numerics/literal_contour.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"
#include "core/seam/point_responses.hpp"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

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

// Nodes of some time points beside each other, and R = N (zI - A)^{-1} B at all of them by one call.
struct SolvedPoints {
  PointContours contours;
  ComplexMatrix R;
};

constexpr double group_bytes = double(1 << 28);  ///< of R, as far as every point has as many nodes as the first one

// use(points) for all time points, in groups of bounded memory; `values` of R at a node.
template <class ContourAt, class Use>
void solve_in_groups(const DiscreteProblem& p, const Dynamics& dynamics, Index values, const ContourAt& at,
                     const Use& use) {
  const double bytes = double(sizeof(Complex)) * double(values) * double(at(p.t[1]).nodes.size());
  const Index most = Index(std::clamp(group_bytes / (1 + bytes), 1.0, double(p.J)));
  for (Index first = 1; first <= p.J; first += most) {
    check_interruption();
    std::vector<Contour> contours(std::size_t(std::min(most, p.J + 1 - first)));
    share_each(p.backend, Index(contours.size()), [&](Index i) { contours[std::size_t(i)] = at(p.t[first + i]); });
    SolvedPoints points{{first, {0}, {}, {}}, {}};
    for (const Contour& c : contours) points.contours.begin.push_back(points.contours.begin.back() + c.nodes.size());
    points.contours.nodes.resize(points.contours.begin.back());
    points.contours.weights.resize(points.contours.begin.back());
    for (std::size_t i = 0; i < contours.size(); ++i) {
      points.contours.nodes.segment(points.contours.begin[i], contours[i].nodes.size()) = contours[i].nodes;
      points.contours.weights.segment(points.contours.begin[i], contours[i].nodes.size()) = contours[i].weights;
    }
    points.R = p.backend.resolvent(dynamics, points.contours.nodes);
    use(points);
  }
}

// With `inputs` columns of u: those of y, or of the source.
class LiteralKernel {
 public:
  LiteralKernel(const DiscreteProblem& p, const Dynamics& dynamics, const Contours& contours, Index inputs)
      : responses_(make_point_responses(p.backend, {p.h, inputs, p.scene.constraints(), p.modes() != nullptr})) {
    const Index n = p.scene.constraints();
    solve_in_groups(
        p, dynamics, p.modes() ? n : n * inputs, [&](double t) { return contours.at(t); },
        [&](SolvedPoints& points) { responses_->add(points.contours, std::move(points.R)); });
    if (!p.modes()) return;
    face_ = p.backend.face_transforms(p.face(), p.J + 1);
    modes_ = p.backend.array(p.J + 1, n);
    result_ = p.backend.array(p.J + 1, n);
  }

  void apply(const Array& u, Array& v) const {
    if (!modes_) return responses_->apply(u, v);
    face_.to_modes->apply(u, nullptr, *modes_, 0);
    responses_->apply(*modes_, *result_);
    face_.to_points->apply(*result_, nullptr, v, 0);
  }

  std::size_t bytes() const { return responses_->bytes(); }

 private:
  std::unique_ptr<PointResponses> responses_;
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
    share_each(p.backend, p.J,
               [&](Index i) { out.row(i + 1) = contour_initial_response(*d, second, lines, p.t[i + 1], 1).row(1); });
    return out;
  }
  const DenseDynamics& d = *p.small_state();
  if (!real)
    return dense_states(step_operators(d.A, Rule::exponential, p.h), p.scene.x0, RowMatrix::Zero(p.J + 1, d.A.rows())) *
           d.N.transpose();
  DenseDynamics start = d;
  start.B = p.scene.x0;
  out.row(0) = d.N * p.scene.x0;
  solve_in_groups(
      p, start, out.cols(), [&](double t) { return window_contour(second, t); },
      [&](const SolvedPoints& points) {
        const PointContours& c = points.contours;
        for (Index i = 0; i < c.points(); ++i) {
          const Index begin = c.begin[std::size_t(i)], count = c.begin[std::size_t(i + 1)] - begin, j = c.first + i;
          const ComplexVector factors =
              c.weights.segment(begin, count).array() * (p.t[j] * c.nodes.segment(begin, count).array()).exp();
          out.row(j) = (factors.transpose() * points.R.middleRows(begin, count)).real();
        }
      });
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
    const auto f = p.backend.array(rows, source.B.cols());
    p.backend.upload(p.f.table(), *f);
    LiteralKernel(p, source, contours, source.B.cols()).apply(*f, *out);
    p.backend.download(*out, part);
    r += part;
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
  const LiteralKernel kernel(p, p.scene.dynamics, contours, n);
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
