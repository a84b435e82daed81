#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/galerkin/recurrence.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/lcp_class.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

namespace {

constexpr double diverging = 1e6;      ///< growth of the change over its least value
constexpr Index patience_sweeps = 60;  ///< without a smaller change
constexpr double rounding_level = 1e-10;

// x_0 = x0_free - from_end r, r = Σ_k E^{N-k} H z_k: S x_0 = b - ET (r + what f adds), S = E0 + ET E^N.
class BoundaryTerm {
 public:
  BoundaryTerm(const GalerkinProblem& p, Backend& backend) : p_(p) {
    const Index m = p.states(), N = p.N;
    Matrix power = Matrix::Identity(m, m);
    std::vector<RowMatrix> modes(std::size_t(m), RowMatrix(N, p.unknowns()));
    for (Index k = 0; k < N; ++k) {
      const Matrix seen = p.first_step().C * power;
      for (Index i = 0; i < m; ++i) modes[std::size_t(i)].row(k) = seen.col(i).transpose();
      power = (p.first_step().E * power).eval();
    }
    const Matrix S = p.boundary.E0 + p.boundary.ET * power;
    if (!S.allFinite()) throw Error("boundary", "e^{TA} overflows", "use the solver for boundary values");
    from_end_ = S.partialPivLu().solve(p.boundary.ET);
    for (const RowMatrix& mode : modes) arrays_.push_back(padded_array(mode, backend));
  }

  // r from the coefficients; the state carried by the causal part alone.
  Vector end_response(const RowMatrix& z) const {
    Vector r = Vector::Zero(p_.states());
    for (Index k = 0; k < p_.N; ++k) r = p_.first_step().E * r + p_.first_step().H * z.row(k).transpose();
    return r;
  }
  Vector initial_change(const Vector& r) const { return -from_end_ * r; }
  const Array& mode(Index i) const { return *arrays_[std::size_t(i)]; }
  std::size_t bytes() const {
    std::size_t sum = 0;
    for (const auto& a : arrays_) sum += a->bytes();
    return sum;
  }

 private:
  const GalerkinProblem& p_;
  std::vector<std::unique_ptr<Array>> arrays_;
  Matrix from_end_;
};

}  // namespace

GalerkinSolution iterate_galerkin(const GalerkinProblem& p, Backend& backend, const Options& options) {
  const LcpMatrix D = p.first_step().D;
  const LcpClass lcp_class = classify(D);
  const Index rows = p.N + 1, n = p.unknowns();
  const RowMatrix zero = RowMatrix::Zero(p.N, n), free_states = galerkin_states(p, zero);
  const auto free = padded_array(galerkin_slack(p, zero, free_states), backend), r = backend.array(rows, n),
             v = backend.array(rows, n), z = backend.array(rows, n);
  backend.inject(*free, *r);
  const Recurrence recurrence = galerkin_recurrence(p.first_step());
  const auto convolution = backend.convolution(recurrence, rows);
  const auto lcp = backend.lcp(D, lcp_class, rows);
  std::optional<BoundaryTerm> boundary;
  if (!p.initial_value) boundary.emplace(p, backend);

  GalerkinSolution s;
  s.iterated = true;
  s.unique = p.initial_value && lcp_class == LcpClass::P;
  Timer timer;
  RowMatrix values = RowMatrix::Zero(rows, n);
  double least = INFINITY;
  Index since = 0;
  for (s.iterations = 1; s.iterations <= options.max_iterations; ++s.iterations) {
    if (options.interrupted && options.interrupted()) {
      s.status = Status::interrupted;
      s.reason = "stopped on request";
      break;
    }
    convolution->apply(*z, *v, 1);
    if (boundary) {
      backend.download(*z, values);
      const Vector x0 = boundary->initial_change(boundary->end_response(values.bottomRows(p.N)));
      backend.inject(*free, *r);
      for (Index i = 0; i < x0.size(); ++i) backend.add(*r, x0[i], boundary->mode(i), *r);
    }
    timer.lap();
    const LcpReport report = lcp->solve(*r, *v, *z, 1, 0);
    s.lcp_seconds += timer.lap();
    s.lcp.solved += report.count.solved;
    s.lcp.newton += report.count.newton;
    s.lcp.fallbacks += report.count.fallbacks;
    s.lcp.unsolved = report.count.unsolved;
    s.history.push_back(report.change);
    if (options.progress) options.progress({s.iterations, report.change, 0});
    if (!report.finite) {
      s.status = Status::nonfinite;
      s.reason = "the iteration is not finite";
      break;
    }
    if (report.count.unsolved > 0) {
      s.reason = "a complementarity problem of a sweep stayed unsolved";
      break;
    }
    since = report.change < least ? 0 : since + 1;
    least = std::min(least, report.change);
    if (report.change <= options.iteration_tolerance || (since >= 3 && least <= rounding_level)) {
      s.status = Status::solved;
      break;
    }
    if (since >= patience_sweeps || report.change > diverging * std::max(least, options.iteration_tolerance)) {
      s.reason = text("the sweeps do not contract (change %.1e)", report.change);
      break;
    }
  }
  if (s.status == Status::tolerance_not_met && s.reason.empty())
    s.reason = text("%ld sweeps were not enough", long(options.max_iterations));
  backend.download(*z, values);
  s.z = values.bottomRows(p.N);
  s.x = galerkin_states(p, s.z);
  s.how = "functional iteration over all intervals";
  s.bytes = free->bytes() + r->bytes() + v->bytes() + z->bytes() + convolution->bytes() + lcp->bytes() +
            (boundary ? boundary->bytes() : 0);
  return s;
}

}  // namespace bromwich
