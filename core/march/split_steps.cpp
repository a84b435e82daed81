#include "core/march/split_steps.hpp"

#include "core/scene/source_steps.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr std::size_t most_kept_parts = 256;  ///< lengths with stored operators
constexpr double same_limit = 1e-9;           ///< relative to the largest: limits of g that count as equal

// Contribution of f to x_j on steps where it is linear.
RowMatrix smooth_forcing(const DiscreteProblem& p, const StepOperators& step) {
  if (p.f.size() == 0) return {};
  const Matrix F = source_matrix(p);
  RowMatrix sum = p.f.table() * (step.right * F).transpose();
  sum.bottomRows(p.J) += p.f.table().topRows(p.J) * (step.left * F).transpose();
  return sum;
}

SplitRule::Limits limits_of(const OneSided& g, const RoughStep& rough, double from) {
  SplitRule::Limits limits;
  for (const double to : rough.ends) {
    limits.after.push_back(g.whole(g.after(from, to - from)));
    limits.before.push_back(g.whole(g.before(to, to - from)));
    from = to;
  }
  return limits;
}

}  // namespace

SplitRule::SplitRule(const DiscreteProblem& problem)
    : p(problem),
      d(*p.small_state()),
      n(p.scene.constraints()),
      step(state_step(p, Rule::exponential)),
      M(to_dense(p.scene.M)),
      driven(step->right * d.B),
      driven_left(step->left * d.B),
      whole(M + d.N * driven),
      whole_class(classify(LcpMatrix(whole))),
      g(p.g.table()),
      forcing(smooth_forcing(p, *step)),
      g_scale(std::max(p.g.values().size() > 0 ? p.g.values().cwiseAbs().maxCoeff() : 0, 1e-290)) {
  if (p.f.size() > 0) F = source_matrix(p);
  if (p.f.size() > 0 && p.f.shapes().size() > 0) F = (F * p.f.shapes()).eval();
  if (!p.sources || !p.scene.g) return;
  const OneSided sides(p.scene.g, n, p.sources->resolution);
  for (const RoughStep& rough : p.sources->rough) limits[rough.step] = limits_of(sides, rough, p.t[rough.step - 1]);
}

SplitSteps::SplitSteps(const SplitRule& rule)
    : rule_(rule),
      least_of_(selects_least(rule.p.lcp_class) ? &rule.M : nullptr),
      propagator_(rule.d.A, rule.p.h),
      lcp_(rule.whole, rule.whole_class, least_of_),
      alone_(rule.M, rule.p.lcp_class, least_of_) {}

void SplitSteps::start(Index j, const Vector& x, const Vector& y, bool with_derivative) {
  x_ = x;
  y_ = y;
  lcp_.start_from(y_);
  next_rough_ = 0;
  if (rule_.p.sources) {
    const std::vector<RoughStep>& rough = rule_.p.sources->rough;
    while (next_rough_ < rough.size() && rough[next_rough_].step <= j) ++next_rough_;
  }
  derives_ = with_derivative;
  runs_ = false;
  hash_ = 0;
  if (!derives_) return;
  const Index m = x.size(), n = y.size();
  dx_ = Matrix::Identity(m, m + n);
  dy_ = Matrix::Zero(n, m + n);
  dy_.rightCols(n).setIdentity();
}

bool SplitSteps::take(Index j, MarchReport& report) {
  smooth_.noalias() = rule_.step->decay * x_;
  smooth_.noalias() += rule_.driven_left * y_;
  if (rule_.forcing.size() > 0) smooth_ += rule_.forcing.row(j).transpose();
  const SourceSteps* sources = rule_.p.sources.get();
  in_parts_ = sources && next_rough_ < sources->rough.size() && sources->rough[next_rough_].step == j;
  return in_parts_ ? take_parts(sources->rough[next_rough_++], report) : take_whole(j, report);
}

bool SplitSteps::take_whole(Index j, MarchReport& report) {
  q_ = rule_.g.row(j).transpose();
  q_.noalias() += rule_.d.N * smooth_;
  impulse_ = rule_.p.h / 2 * y_;
  if (!solve(lcp_, q_, y_, j, report)) return false;
  impulse_ += rule_.p.h / 2 * y_;
  x_ = smooth_;
  x_.noalias() += rule_.driven * y_;
  if (derives_) follow_whole();
  return true;
}

bool SplitSteps::take_parts(const RoughStep& rough, MarchReport& report) {
  const DiscreteProblem& p = rule_.p;
  const Index j = rough.step;
  const auto limits = rule_.limits.find(j);
  const bool has_g = limits != rule_.limits.end();
  double from = p.t[j - 1];
  std::size_t piece = 0;
  Vector g_before = rule_.g.row(j - 1).transpose();
  impulse_ = Vector::Zero(rule_.n);
  if (derives_) end_run();
  for (std::size_t k = 0; k < rough.ends.size(); ++k) {
    const double to = rough.ends[k], d = to - from;
    if (has_g && !restart(g_before, limits->second.after[k], j, report)) return false;
    g_before = has_g ? limits->second.before[k] : Vector(Vector::Zero(rule_.n));
    drift(rough, piece, from, to);
    impulse_ += d / 2 * y_;
    Part& part = part_of(d);
    q_ = g_before + rule_.d.N * x_;
    if (!solve(*part.lcp, q_, y_, j, report)) return false;
    x_ += part.driven * y_;
    impulse_ += d / 2 * y_;
    if (derives_) follow_part(d, part);
    from = to;
  }
  lcp_.start_from(y_);
  return restart(g_before, rule_.g.row(j).transpose(), j, report);
}

// y after a jump of g.
bool SplitSteps::restart(const Vector& before, const Vector& after, Index j, MarchReport& report) {
  if ((before - after).cwiseAbs().maxCoeff() <= same_limit * rule_.g_scale) return true;
  q_ = after + rule_.d.N * x_;
  if (!solve(alone_, q_, y_, j, report)) return false;
  if (derives_) follow_restart();
  return true;
}

// x over a part, with y falling linearly to zero and with f.
void SplitSteps::drift(const RoughStep& rough, std::size_t& piece, double from, double to) {
  const Vector By = rule_.d.B * y_;
  const double d = to - from;
  Matrix state = x_;
  const auto advance = [&](double start, double length, const Matrix* phi) {
    const double first = 1 - (start - from) / d;
    QuadraticInput u{first * By, -length / d * By, Matrix::Zero(By.size(), 1)};
    if (phi) {
      const Matrix f = rule_.F * *phi;
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
SplitSteps::Part& SplitSteps::part_of(double d) {
  const DiscreteProblem& p = rule_.p;
  const auto key = std::llround(d / std::max(std::ldexp(p.h, -40), p.sources->resolution / 16));
  if (const auto found = parts_.find(key); found != parts_.end()) return found->second;
  if (parts_.size() >= most_kept_parts) parts_.clear();
  Part& part = parts_[key];
  part.driven = Matrix::Zero(rule_.d.B.rows(), rule_.n);
  const Matrix none = part.driven;
  propagator_.advance(d, {none, rule_.d.B, none}, part.driven);
  // The matrix lies between M and M + W_0 of a whole step: class P if both are. A solution is accepted by its
  // residual.
  const bool is_P = has_one_solution(p.lcp_class) && has_one_solution(rule_.whole_class);
  const LcpClass c = is_P ? LcpClass::P : selects_least(p.lcp_class) ? rule_.whole_class : LcpClass::unknown;
  part.matrix = rule_.M + rule_.d.N * part.driven;
  part.lcp.emplace(part.matrix, c, least_of_);
  part.lcp->start_from(y_);
  return part;
}

bool SplitSteps::solve(ActiveSetLcp& lcp, const Vector& q, Vector& y, Index j, MarchReport& report) {
  const bool timed = solved_++ % timed_every == 0;
  if (timed) timer_.lap();
  const LcpOutcome outcome = lcp.solve(q, y);
  if (timed) report.lcp_seconds += double(timed_every) * timer_.lap();
  return host::count_step(outcome, q, has_one_solution(rule_.p.lcp_class), j, report);
}

// z over the whole step before this one, in which y was last_.
void SplitSteps::follow_whole() {
  if (!runs_) run_.begin(x_.size());
  if (runs_)
    run_.step(key_, [&] {
      const Matrix& E = rule_.step->decay;
      const Matrix input = E * rule_.driven + rule_.driven_left;
      return Matrix(E + input * Matrix(held_solution(rule_.whole, last_) * rule_.d.N));
    });
  runs_ = true;
  last_ = y_;
  key_.clear();
  append_positive(y_, key_);
}

// From (x, y) before a run of whole steps to (x, y) behind it.
void SplitSteps::end_run() {
  if (!runs_) return;
  const Matrix z = run_.product() * Matrix(rule_.step->decay * dx_ + rule_.driven_left * dy_);
  dy_ = held_solution(rule_.whole, last_) * Matrix(rule_.d.N * z);
  dx_ = z + rule_.driven * dy_;
  hash_ = hash_of(hash_of(hash_, {run_.sets()}), key_);
  runs_ = false;
}

void SplitSteps::follow_part(double d, Part& part) {
  const Index m = dx_.rows();
  if (part.decay.size() == 0) {
    const Matrix none = Matrix::Zero(m, m), nothing = Matrix::Zero(m, rule_.n);
    part.decay = Matrix::Identity(m, m);
    propagator_.advance(d, {none, none, none}, part.decay);
    part.falling = nothing;
    propagator_.advance(d, {rule_.d.B, -rule_.d.B, nothing}, part.falling);
  }
  dx_ = (part.decay * dx_ + part.falling * dy_).eval();
  dy_ = held_solution(part.matrix, y_) * Matrix(rule_.d.N * dx_);
  dx_ += part.driven * dy_;
  key_.clear();
  append_positive(y_, key_);
  hash_ = hash_of(hash_, key_);
}

void SplitSteps::follow_restart() {
  dy_ = held_solution(rule_.M, y_) * Matrix(rule_.d.N * dx_);
  key_.clear();
  append_positive(y_, key_);
  hash_ = hash_of(hash_, key_);
}

Matrix SplitSteps::derivative() {
  end_run();
  Matrix D(dx_.rows() + dy_.rows(), dx_.cols());
  D << dx_, dy_;
  return D;
}

std::uint64_t SplitSteps::sets() {
  end_run();
  return hash_;
}

}  // namespace bromwich
