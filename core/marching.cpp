#include "core/marching.hpp"

#include "core/compression.hpp"
#include "core/lcp.hpp"
#include "core/timer.hpp"

#include <cmath>
#include <cstdio>
#include <type_traits>

namespace bromwich {

namespace {

struct Plan {
  Recurrence recurrence;
  RowMatrix r;  ///< what the recurrence leaves out
  double error = NAN;
};

// S N (discrete e^{A t_j}) x0 by stepping all modes: for x0 that the driven recurrence cannot carry.
RowMatrix stepped_initial_response(const DiscreteProblem& p, Rule rule) {
  const KroneckerDynamics& d = *p.kronecker();
  const Vector mu = d.along.eigenvalues(), nu = d.across.eigenvalues(), seen = sine_matrix(nu.size()) * d.n;
  RowMatrix x = x0_in_modes(p.backend, d, p.scene.x0, true), decay(x.rows(), x.cols()), modes(p.J + 1, x.rows());
  for (Index l = 0; l < mu.size(); ++l)
    for (Index k = 0; k < nu.size(); ++k) {
      const double z = p.h * (mu[l] + nu[k]);
      decay(l, k) = rule == Rule::exponential ? std::exp(z) : 1 / (1 - z);
    }
  for (Index j = 0; j <= p.J; ++j, x.array() *= decay.array()) modes.row(j) = (x * seen).transpose();
  return modes;
}

// g + S modes, on the host.
RowMatrix with_modes(const DiscreteProblem& p, const RowMatrix& values) {
  const auto modes = p.backend.array(values.rows(), values.cols()), r = p.backend.array(values.rows(), values.cols());
  p.backend.upload(values, *modes);
  p.backend.upload(p.g, *r);
  p.backend.sine_transform(values.cols(), values.rows())->apply(*modes, r.get(), *r, 0);
  RowMatrix sum;
  p.backend.download(*r, sum);
  return sum;
}

Plan modal_plan(const DiscreteProblem& p, Rule rule) {
  const KroneckerDynamics& d = *p.kronecker();
  const Vector b = sine_matrix(d.across.points) * d.b;
  if (b.cwiseAbs().minCoeff() <= 1e-10 * b.cwiseAbs().maxCoeff())
    return {modal_recurrence(d, rule, p.h, RowMatrix()), with_modes(p, stepped_initial_response(p, rule))};
  return {modal_recurrence(d, rule, p.h, x0_in_modes(p.backend, d, p.scene.x0, true)), p.g};
}

Plan compressed_plan(const DiscreteProblem& p, const ExponentialSum& sum) {
  return {compressed_recurrence(p.backend, *p.kronecker(), sum, p.h), with_modes(p, kronecker_initial_response(p)),
          sum.error};
}

Plan make_plan(const DiscreteProblem& p, Rule rule, RecurrenceChoice choice, std::string& description) {
  if (const DenseDynamics* d = p.dense()) {
    description = "state of the scene, stepped";
    return {dense_recurrence(*d, rule, p.h), dense_response(p, rule)};
  }
  const Index all = p.kronecker()->across.points;
  if (rule == Rule::exponential && choice != RecurrenceChoice::modal) {
    const ExponentialSum sum = compress_line_kernel(*p.kronecker(), p.h, p.scene.T);
    const bool fits = sum.error <= accepted_compression_error;
    if (fits && (choice == RecurrenceChoice::compressed || 2 * sum.rates.size() <= all)) {
      description = std::to_string(sum.rates.size()) + " exponentials a mode, stepped";
      return compressed_plan(p, sum);
    }
  }
  description = std::to_string(all) + " eigenvalues a mode, stepped";
  return modal_plan(p, rule);
}

std::size_t bytes_of(const Plan& plan) {
  const Index numbers = std::visit(
      [](const auto& r) {
        if constexpr (std::is_same_v<std::decay_t<decltype(r)>, ModalRecurrence>)
          return 3 * r.decay.size() + r.initial.size();
        else
          return r.decay.size() + 3 * r.input.size();
      },
      plan.recurrence);
  return sizeof(double) * std::size_t(numbers + plan.r.size());
}

// y_0 in SOL(M, N x0 + g(0)): one problem, as a batch of one row. False: there is none, and the result says why.
bool solve_at_zero(const DiscreteProblem& p, Result& result) {
  const Index n = p.scene.constraints();
  const auto r = p.backend.array(1, n), v = p.backend.array(1, n), y = p.backend.array(1, n);
  p.backend.upload(p.start.transpose(), *r);
  const LcpReport report = p.backend.lcp(p.scene.M, p.lcp_class, 1)->solve(*r, *v, *y, 0, 0);
  result.lcp.newton += report.count.newton;
  result.y = RowMatrix::Constant(p.J + 1, n, NAN);
  if (report.count.unsolved == 0 && report.finite) {
    RowMatrix start;
    p.backend.download(*y, start);
    result.y.row(0) = start;
    ++result.lcp.solved;
    return true;
  }
  result.status = report.infeasible == 0 ? Status::infeasible : Status::tolerance_not_met;
  result.reason = report.infeasible == 0 ? "no solution at t = 0" : "the problem at t = 0 stayed unsolved";
  if (report.infeasible == 0) result.infeasible_at = 0;
  return false;
}

void explain_stop(const DiscreteProblem& p, const MarchReport& report, Result& result) {
  char where[64];
  std::snprintf(where, sizeof where, "t = %.6g", p.t[report.stopped]);
  if (report.interrupted) {
    result.status = Status::interrupted;
    result.reason = std::string("stopped on request at ") + where;
  } else if (!report.finite) {
    result.status = Status::nonfinite;
    result.reason = std::string("the solution is not finite at ") + where;
  } else if (report.infeasible >= 0) {
    result.status = Status::infeasible;
    result.infeasible_at = p.t[report.infeasible];
    result.reason = std::string("no solution from ") + where + " on";
  } else {
    result.status = Status::tolerance_not_met;
    result.reason = std::string("the complementarity problem of the step to ") + where +
                    " stayed unsolved; try other steps or method contour";
  }
}

}  // namespace

void solve_by_marching(const DiscreteProblem& p, Rule rule, const Options& options, Result& result) {
  Timer timer;
  const Index rows = p.J + 1, n = p.scene.constraints();
  Plan plan = make_plan(p, rule, options.recurrence, result.kernel);
  result.kernel_error = plan.error;
  plan.r.row(0) = p.start.transpose();
  const auto y = p.backend.array(rows, n), v = p.backend.array(rows, n), r = p.backend.array(rows, n);
  p.backend.upload(plan.r, *r);
  std::unique_ptr<Array> drive;
  if (p.kronecker() && p.drive()) {
    drive = p.backend.array(rows, n);
    p.backend.upload(*p.drive(), *drive);
  }
  MarchProblem problem{&p.scene.M, p.lcp_class, &plan.recurrence, r.get(), drive.get(), options.interrupted, {}};
  if (options.progress) problem.progress = [&](Index step) { options.progress({step, 0, p.J}); };
  const auto march = p.backend.march(problem, rows);
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, rows);
  result.bytes =
      y->bytes() * 3 + (drive ? drive->bytes() : 0) + march->bytes() + lcp->bytes() + bytes_of(plan) + host_bytes(p);
  result.seconds.setup += timer.lap();

  if (!solve_at_zero(p, result)) return;
  p.backend.upload(result.y, *y);
  result.seconds.lcp += timer.lap();
  const MarchReport report = march->run(*y, *v);
  p.backend.download(*y, result.y);
  result.iterations = 1;
  result.lcp.solved += report.count.solved;
  result.lcp.newton += report.count.newton;
  result.lcp.fallbacks += report.count.fallbacks;
  result.lcp.unsolved += report.count.unsolved;
  result.seconds.lcp += report.lcp_seconds;
  if (report.stopped >= 0) return explain_stop(p, report, result);
  result.residual = lcp->residual(*r, *v, *y);
  result.status = Status::solved;
}

}  // namespace bromwich
