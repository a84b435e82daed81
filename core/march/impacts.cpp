#include "core/march/impacts.hpp"

#include "core/base/denormals.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/host/step_lcp.hpp"
#include "core/march/impact_steps.hpp"
#include "core/march/outcome.hpp"
#include "core/scene/has_impacts.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_pieces = 64;  ///< of the flow over a step

// The parabola through values at 0, length / 2 and length.
template <class Values>
void set_parabola(const Values& from, const Values& middle, const Values& to, double length, Matrix& c) {
  c.resize(from.size(), 3);
  for (Index i = 0; i < from.size(); ++i) {
    c(i, 0) = from[i];
    c(i, 1) = (4 * middle[i] - 3 * from[i] - to[i]) / length;
    c(i, 2) = 2 * (from[i] - 2 * middle[i] + to[i]) / (length * length);
  }
}

// f and g of every step, divided where they are not smooth.
class SourcesOfSteps {
 public:
  explicit SourcesOfSteps(const DiscreteProblem& p) : p_(p), F_(matrix(p.scene)), smooth_(1) {
    smooth_[0] = {0, p.h, Matrix::Zero(p.scene.states(), 3), Matrix::Zero(p.scene.constraints(), 3), false};
    Vector middles(p.J);
    for (Index j = 0; j < p.J; ++j) middles[j] = (p.t[j] + p.t[j + 1]) / 2;
    if (p.f.size() > 0) f_ = sample(p.scene.f, middles, p.scene.sources());
    if (p.scene.g) g_ = sample(p.scene.g, middles, p.scene.constraints());
    if (!p.sources) return;
    of_f_.emplace(p.scene.f, p.scene.sources(), p.sources->resolution);
    of_g_.emplace(p.scene.g, p.scene.constraints(), p.sources->resolution);
  }

  /// Until the next call.
  const std::vector<SmoothSources>& of_step(Index j) {
    const RoughStep* rough = p_.sources ? p_.sources->at(j) : nullptr;
    const bool breaks = rough || std::exchange(was_rough_, rough != nullptr);
    if (!rough) {
      set_smooth(j, breaks);
      return smooth_;
    }
    std::vector<double> ends = rough->ends;
    for (const SourcePiece& piece : rough->pieces) ends.push_back(piece.start);
    std::sort(ends.begin(), ends.end());
    parts_.clear();
    double from = p_.t[j - 1];
    for (const double to : ends) {
      if (!(to - from > 1e-9 * p_.h)) continue;
      parts_.push_back(between(from, to));
      from = to;
    }
    return parts_;
  }

 private:
  static SparseMatrix matrix(const Scene& scene) {
    if (scene.f_entry == SourceEntry::through_F) return scene.F;
    if (scene.f_entry == SourceEntry::through_B) return scene.dynamics->inputs();
    SparseMatrix identity(scene.states(), scene.states());
    identity.setIdentity();
    return identity;
  }

  void set_smooth(Index j, bool breaks) {
    SmoothSources& s = smooth_[0];
    s.begin = p_.t[j - 1], s.breaks = breaks;
    if (p_.f.size() > 0) {
      set_parabola<Vector>(p_.f.row(j - 1), f_.row(j - 1), p_.f.row(j), p_.h, shapes_);
      s.f = F_ * shapes_;
    }
    if (p_.scene.g) set_parabola<Vector>(p_.g.row(j - 1), g_.row(j - 1), p_.g.row(j), p_.h, s.g);
  }

  static Matrix of(const OneSided& source, double from, double to) {
    Vector middle;
    source.value((from + to) / 2, middle);
    Matrix c;
    set_parabola<Vector>(source.whole(source.after(from, to - from)), source.whole(middle),
                         source.whole(source.before(to, to - from)), to - from, c);
    return c;
  }

  SmoothSources between(double from, double to) const {
    SmoothSources s{from, to - from, Matrix::Zero(p_.scene.states(), 3), Matrix::Zero(p_.scene.constraints(), 3), true};
    if (p_.f.size() > 0) s.f = F_ * of(*of_f_, from, to);
    if (p_.scene.g) s.g = of(*of_g_, from, to);
    return s;
  }

  const DiscreteProblem& p_;
  const SparseMatrix F_;
  SampledSource f_, g_;  ///< in the middle of each step
  std::optional<OneSided> of_f_, of_g_;
  bool was_rough_ = false;
  std::vector<SmoothSources> smooth_, parts_;  ///< of the last step
  Matrix shapes_;
};

RowMatrix unknown_rows(Index rows, Index width) { return RowMatrix::Constant(rows, width, NAN); }

// Rows up to the one that stays unsolved, which the report of the steps names.
void march(const DiscreteProblem& p, const Options& options, ImpactSteps& steps, Result& result) {
  const FlushDenormals flush;
  const auto progress = [&options, J = p.J](Index j) {
    if (options.progress) options.progress({j, 0, J});
  };
  const host::Poll asked_to_stop(options.interrupted, progress);
  SourcesOfSteps sources(p);
  MarchReport& report = steps.report();
  for (Index j = 1; j <= p.J; ++j) {
    bool solved = !asked_to_stop(j, report);
    const std::vector<SmoothSources>& parts = sources.of_step(j);
    if (j == 1) {
      solved = solved && steps.start(parts[0]);
      result.starts_with_impulse = !steps.impacts().empty();
    } else {
      steps.begin_step();
    }
    for (const SmoothSources& part : parts) solved = solved && steps.pass(part);
    if (!solved) {
      report.stopped = j;
      return;
    }
    result.x.row(j) = steps.x()(p.components).transpose();
    result.y.row(j) = steps.y().transpose();
    result.y_integral.row(j) = result.y_integral.row(j - 1) + steps.integral().transpose();
    if (options.trace) result.trace.row(j) = observe(p.scene.dynamics, steps.x()).transpose();
  }
}

}  // namespace

std::optional<ImpactRows> rows_of_impacts(const DiscreteProblem& p) {
  std::optional<ImpactRows> rows = impact_rows(p.scene);
  if (!rows || ImpactFlow(rows->A).pieces(p.h) > most_pieces) return std::nullopt;
  const Vector g = p.g.row(0), w = rows->N * p.scene.x0 + g, zero = rows->touching(p.scene.x0, g);
  for (Index i = 0; i < w.size(); ++i)
    if (rows->is(i, ImpactRows::Kind::gap) && w[i] < -zero[i]) return std::nullopt;
  return rows;
}

bool needs_location(const DiscreteProblem& p) { return has_impacts(p.scene) || !p.scene.cones.empty(); }

void refuse_impacts(Result& result) {
  result.status = Status::unsupported;
  result.reason =
      "steps over impacts with restitution and friction on circles take rigid and compliant contacts, from states that "
      "are not beyond a rigid one, and steps that are not long beside the fastest mode; use more steps or method "
      "events";
}

void solve_over_impacts(const DiscreteProblem& p, const ImpactRows& rows, const Options& options, Result& result) {
  Timer timer;
  const Index count_of_rows = p.J + 1, n = p.scene.constraints();
  ImpactSteps steps(rows, p.h, p.scene.x0);
  steps.report().well_posed = rows.have_one_solution();
  result.seconds.setup += timer.lap();
  result.y = result.y_integral = unknown_rows(count_of_rows, n);
  result.x = unknown_rows(count_of_rows, Index(p.components.size()));
  result.x.row(0) = p.scene.x0(p.components).transpose();
  result.y_integral.row(0).setZero();
  if (options.trace) {
    result.trace = unknown_rows(count_of_rows, n);
    result.trace.row(0) = observe(p.scene.dynamics, p.scene.x0).transpose();
  }
  march(p, options, steps, result);
  if (steps.first().size() > 0) result.y.row(0) = steps.first().transpose();
  result.continuous = false;
  if (p.sources) result.defects = std::make_shared<StepDefects>();
  result.kernel = text("state of the scene by its exact flow, steps divided at %zu impacts", steps.impacts().size());
  result.impacts = std::make_shared<const std::vector<Impact>>(steps.impacts());
  result.kernel_error = 0;
  result.well_posed = steps.report().well_posed;
  result.bytes = sizeof(double) * std::size_t(2 * result.y.size() + result.x.size()) + host_bytes(p);
  steps.report().lcp_seconds = timer.lap();
  count(steps.report(), result);
  result.residual = steps.residual();
  if (steps.report().stopped >= 0) return explain_stop(p, steps.report(), result);
  result.status = Status::solved;
}

}  // namespace bromwich
