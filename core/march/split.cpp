#include "core/march/split.hpp"

#include "core/base/timer.hpp"
#include "core/host/step_lcp.hpp"
#include "core/kernel/weight_check.hpp"
#include "core/lcp/active_set.hpp"
#include "core/march/outcome.hpp"
#include "core/numerics/step_propagator.hpp"
#include "core/scene/source_steps.hpp"

#include <cmath>
#include <map>
#include <optional>

namespace bromwich {

namespace {

constexpr std::size_t most_kept_parts = 256;  ///< lengths with stored operators
constexpr double same_limit = 1e-9;           ///< relative to the largest: limits of g that count as equal

// Operators for the effect of y at the end of a part.
struct Part {
  Matrix driven;  ///< m x n: contribution to x of y rising linearly from 0
  std::optional<ActiveSetLcp> lcp;
};

class SplitMarch {
 public:
  SplitMarch(const DiscreteProblem& p, const Options& options)
      : p_(p),
        asked_to_stop_(options.interrupted,
                       [&options, J = p.J](Index j) {
                         if (options.progress) options.progress({j, 0, J});
                       }),
        d_(*p.small_state()),
        n_(p.scene.constraints()),
        step_(state_step(p, Rule::exponential)),
        M_(to_dense(p.scene.M)),
        least_of_(selects_least(p.lcp_class) ? &M_ : nullptr),
        driven_(step_->right * d_.B),
        driven_left_(step_->left * d_.B),
        propagator_(d_.A, p.h),
        g_(p.scene.g, n_, p.sources->resolution),
        whole_(M_ + d_.N * driven_),
        whole_class_(classify(LcpMatrix(whole_))),
        lcp_(whole_, whole_class_, least_of_),
        alone_(M_, p.lcp_class, least_of_) {
    if (p.f.size() == 0) return;
    F_ = source_matrix(p);
    if (p.f.shapes().size() > 0) F_ = (F_ * p.f.shapes()).eval();
  }

  // Starts from y_0. Fills the rows of y, of its integral from 0, and of x.
  MarchReport run(RowMatrix& y, RowMatrix& integral, RowMatrix& x, StepDefects& defects) {
    const RowMatrix forcing = smooth_forcing();
    g_scale_ = std::max(p_.g.values().size() > 0 ? p_.g.values().cwiseAbs().maxCoeff() : 0, 1e-290);
    MarchReport report;
    report.well_posed = selects_least(p_.lcp_class) || has_convex_solutions(whole_class_);
    x.row(0) = p_.scene.x0.transpose();
    x_ = p_.scene.x0;
    y_ = y.row(0).transpose();
    integral.row(0).setZero();
    lcp_.start_from(y_);
    std::size_t next_rough = 0;
    const std::vector<RoughStep>& rough = p_.sources->rough;
    for (Index j = 1; j <= p_.J; ++j) {
      if (asked_to_stop_(j, report)) return report;
      smooth_ = step_->decay * x_ + driven_left_ * y_;
      if (forcing.size() > 0) smooth_ += forcing.row(j).transpose();
      const bool is_rough = next_rough < rough.size() && rough[next_rough].step == j;
      if (!(is_rough ? take_parts(rough[next_rough], report) : take_whole(j, report))) return report;
      if (is_rough) {
        defects.steps.push_back(j);
        defects.values.conservativeResize(Index(++next_rough), x_.size());
        defects.values.row(Index(next_rough) - 1) = (x_ - smooth_ - driven_ * y_).transpose();
      }
      x.row(j) = x_.transpose();
      y.row(j) = y_.transpose();
      integral.row(j) = integral.row(j - 1) + impulse_.transpose();
    }
    return report;
  }

 private:
  // Contribution of f to x_j on steps where it is linear.
  RowMatrix smooth_forcing() const {
    if (p_.f.size() == 0) return {};
    const Matrix F = source_matrix(p_);
    RowMatrix sum = p_.f.table() * (step_->right * F).transpose();
    sum.bottomRows(p_.J) += p_.f.table().topRows(p_.J) * (step_->left * F).transpose();
    return sum;
  }

  bool take_whole(Index j, MarchReport& report) {
    q_ = p_.g.row(j) + d_.N * smooth_;
    impulse_ = p_.h / 2 * y_;
    if (!solve(lcp_, q_, y_, j, report)) return false;
    impulse_ += p_.h / 2 * y_;
    x_ = smooth_ + driven_ * y_;
    return true;
  }

  bool take_parts(const RoughStep& rough, MarchReport& report) {
    const Index j = rough.step;
    double from = p_.t[j - 1];
    std::size_t piece = 0;
    Vector g_before = p_.g.row(j - 1);
    impulse_ = Vector::Zero(n_);
    for (const double to : rough.ends) {
      const double d = to - from;
      if (p_.scene.g && !restart(g_before, g_.whole(g_.after(from, d)), j, report)) return false;
      g_before = p_.scene.g ? g_.whole(g_.before(to, d)) : Vector(Vector::Zero(n_));
      drift(rough, piece, from, to);
      impulse_ += d / 2 * y_;
      Part& part = part_of(d);
      q_ = g_before + d_.N * x_;
      if (!solve(*part.lcp, q_, y_, j, report)) return false;
      x_ += part.driven * y_;
      impulse_ += d / 2 * y_;
      from = to;
    }
    lcp_.start_from(y_);
    return restart(g_before, p_.g.row(j), j, report);
  }

  // y after a jump of g.
  bool restart(const Vector& before, const Vector& after, Index j, MarchReport& report) {
    if ((before - after).cwiseAbs().maxCoeff() <= same_limit * g_scale_) return true;
    q_ = after + d_.N * x_;
    return solve(alone_, q_, y_, j, report);
  }

  // x over a part, with y falling linearly to zero and with f.
  void drift(const RoughStep& rough, std::size_t& piece, double from, double to) {
    const Vector By = d_.B * y_;
    const double d = to - from;
    Matrix state = x_;
    const auto advance = [&](double start, double length, const Matrix* phi) {
      const double first = 1 - (start - from) / d;
      QuadraticInput u{first * By, -length / d * By, Matrix::Zero(By.size(), 1)};
      if (phi) {
        const Matrix f = F_ * *phi;
        u.c0 += f.col(0);
        u.c1 += f.col(1);
        u.c2 = f.col(2);
      }
      propagator_.advance(length, u, state);
    };
    if (rough.pieces.empty()) advance(from, d, nullptr);
    for (; piece < rough.pieces.size() && rough.pieces[piece].start < to; ++piece)
      advance(rough.pieces[piece].start, rough.pieces[piece].length, &rough.pieces[piece].phi);
    x_ = state;
  }

  // Lengths that agree to 2^-40 of a step count as equal, and those of many steps to the rounding of their ends.
  Part& part_of(double d) {
    const auto key = std::llround(d / std::max(std::ldexp(p_.h, -40), p_.sources->resolution / 16));
    if (const auto found = parts_.find(key); found != parts_.end()) return found->second;
    if (parts_.size() >= most_kept_parts) parts_.clear();
    Part& part = parts_[key];
    part.driven = Matrix::Zero(d_.B.rows(), n_);
    const Matrix none = part.driven;
    propagator_.advance(d, {none, d_.B, none}, part.driven);
    // The matrix lies between M and M + W_0 of a whole step: class P if both are. A solution is accepted by its
    // residual.
    const bool is_P = has_one_solution(p_.lcp_class) && has_one_solution(whole_class_);
    const LcpClass c = is_P ? LcpClass::P : selects_least(p_.lcp_class) ? whole_class_ : LcpClass::unknown;
    part.lcp.emplace(M_ + d_.N * part.driven, c, least_of_);
    part.lcp->start_from(y_);
    return part;
  }

  bool solve(ActiveSetLcp& lcp, const Vector& q, Vector& y, Index j, MarchReport& report) {
    Timer timer;
    const LcpOutcome outcome = lcp.solve(q, y);
    report.lcp_seconds += timer.lap();
    return host::count_step(outcome, q, has_one_solution(p_.lcp_class), j, report);
  }

  const DiscreteProblem& p_;
  host::Poll asked_to_stop_;
  const DenseDynamics& d_;
  Index n_;
  std::shared_ptr<const StepOperators> step_;
  Matrix M_;
  const Matrix* least_of_;
  Matrix driven_, driven_left_;
  StepPropagator propagator_;
  OneSided g_;
  Matrix whole_;  ///< M + W_0
  LcpClass whole_class_;
  ActiveSetLcp lcp_, alone_;
  Matrix F_;
  double g_scale_ = 1;
  std::map<long long, Part> parts_;
  Vector x_, y_, smooth_, q_;
  Vector impulse_;  ///< integral of y over the step
};

// r = g and v = N x as backend arrays: residual and trace are computed as for every march.
void look_at(const DiscreteProblem& p, const Options& options, const RowMatrix& x, Result& result) {
  RowMatrix known = p.g.table(), seen = x * p.small_state()->N.transpose();
  known.row(0) = p.start.transpose();
  seen.row(0).setZero();
  const auto array = [&](const RowMatrix& values) {
    auto on_backend = p.backend.array(values.rows(), values.cols());
    p.backend.upload(values, *on_backend);
    return on_backend;
  };
  const auto r = array(known), v = array(seen), y = array(result.y);
  if (options.trace) result.trace = trace(p, *r, *v);
  if (result.y.allFinite()) result.residual = march_residual(p, Start::found, *r, *v, *y);
}

}  // namespace

void solve_by_split_marching(const DiscreteProblem& p, const Options& options, Result& result) {
  Timer timer;
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  const WeightCheck check = check_weights(p, dense_recurrence(*p.small_state(), *state_step(p, Rule::exponential)),
                                          double(p.J) * (m * m + 2 * m * n));
  result.kernel_error = check.error;
  result.kernel = "state of the scene, stepped by the matrix exponential" +
                  (check.against.empty() ? "" : ", checked against " + check.against) + "; " +
                  std::to_string(p.sources->rough.size()) + " steps in parts, where sources are not smooth";
  SplitMarch march(p, options);
  result.seconds.setup += timer.lap();
  const Start start = solve_at_zero(p, result);
  if (start == Start::none) return;
  if (start == Start::impulse) {
    result.status = Status::unsupported;
    result.reason = "x0 violates the constraints and y has to jump; use method march or auto";
    return;
  }
  result.seconds.lcp += timer.lap();
  RowMatrix x = RowMatrix::Constant(p.J + 1, p.scene.states(), NAN);
  result.y_integral = RowMatrix::Constant(p.J + 1, p.scene.constraints(), NAN);
  const auto defects = std::make_shared<StepDefects>();
  const MarchReport report = march.run(result.y, result.y_integral, x, *defects);
  result.defects = defects;
  result.x = x(Eigen::all, p.components);
  result.bytes = sizeof(double) * std::size_t(2 * result.y.size() + x.size()) + host_bytes(p);
  count(report, result);
  result.well_posed = report.well_posed;
  look_at(p, options, x, result);
  if (report.stopped >= 0) return explain_stop(p, report, result);
  result.status = Status::solved;
}

}  // namespace bromwich
