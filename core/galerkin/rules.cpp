#include "core/galerkin/rules.hpp"

#include "core/base/text.hpp"
#include "core/galerkin/sources.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double singular_block = 1e-12;  ///< reciprocal condition of M_SS
constexpr double lost_rank = 1e-9;        ///< of what y does to w' on its null space
constexpr double just_before = 1e-9;      ///< of an interval: the value at its end from the left

struct Tableau {
  Matrix a;
  Vector c, weights;
};

Tableau tableau(IntervalRule rule) {
  if (rule == IntervalRule::radau)
    return {Matrix{{5. / 12, -1. / 12}, {3. / 4, 1. / 4}}, Vector{{1. / 3, 1}}, Vector{{1.5, 0.5}}};
  return {Matrix{{1}}, Vector{{1}}, Vector{{1}}};
}

// The stages of an interval of length h: X = start x + drive (y_1, ..) + push (f_1, ..), s m rows each.
struct Stages {
  Matrix start, drive, push;
};

Stages stages(const Tableau& rule, const DenseDynamics& d, const Matrix& entry, double h) {
  const Index m = d.A.rows(), n = d.B.cols(), k = entry.cols(), s = rule.c.size();
  Matrix system = Matrix::Identity(s * m, s * m), right(s * m, m + s * (n + k));
  for (Index i = 0; i < s; ++i) {
    right.block(i * m, 0, m, m).setIdentity();
    for (Index j = 0; j < s; ++j) {
      const double a = h * rule.a(i, j);
      system.block(i * m, j * m, m, m) -= a * d.A;
      right.block(i * m, m + j * n, m, n) = a * d.B;
      right.block(i * m, m + s * n + j * k, m, k) = a * entry;
    }
  }
  const Equilibration scale = equilibrate(system);  // units of the states may differ
  const Eigen::PartialPivLU<Matrix> lu(scale.rows.asDiagonal() * system * scale.columns.asDiagonal());
  const Matrix X = scale.columns.asDiagonal() * lu.solve(scale.rows.asDiagonal() * right);
  return {X.leftCols(m), X.middleCols(m, s * n), X.rightCols(s * k)};
}

// Rows of the two conditions of an interval from the stages; Euler states its only one twice.
Matrix seen(const Matrix& N, const Tableau& rule, const Matrix& X) {
  const Index m = N.cols(), n = N.rows(), s = rule.c.size();
  Matrix rows(2 * n, X.cols());
  for (Index i = 0; i < 2; ++i) {
    const Index stage = std::min(i, s - 1);
    rows.middleRows(i * n, n) = rule.weights[stage] * N * X.middleRows(stage * m, m);
  }
  return rows;
}

GalerkinStep stage_step(const Stages& X, const Tableau& rule, const DenseDynamics& d, const Matrix& M) {
  const Index m = d.A.rows(), n = d.B.cols(), s = rule.c.size();
  GalerkinStep step{X.start.bottomRows(m), Matrix(m, 2 * n), seen(d.N, rule, X.start), Matrix::Zero(2 * n, 2 * n),
                    Matrix::Zero(2 * n, 2 * n)};
  const Matrix response = seen(d.N, rule, X.drive);
  if (s == 2) {
    step.H = X.drive.bottomRows(m);
    step.D = response;
  } else {  // two copies of one problem
    step.H << X.drive / 2, X.drive / 2;
    step.D.topLeftCorner(n, n) = response.topRows(n);
    step.D.bottomRightCorner(n, n) = response.topRows(n);
  }
  for (Index i = 0; i < 2; ++i) step.M.block(i * n, i * n, n, n) = rule.weights[std::min(i, s - 1)] * M;
  step.D += step.M;
  return step;
}

// f of the stages of an interval; implicit Euler takes its mean.
Vector stage_sources(const Scene& scene, IntervalRule rule, const Tableau& tableau, double begin, double h,
                     GalerkinSources& sources) {
  if (rule == IntervalRule::euler) return sources.mean_of_f(begin, h);
  const Index k = scene.sources(), s = tableau.c.size();
  Vector values = Vector::Zero(s * k), f(k);
  for (Index i = 0; i < s && scene.f; ++i) {
    scene.f(begin + std::min(tableau.c[i], 1 - just_before) * h, f);
    values.segment(i * k, k) = f;
  }
  return values;
}

}  // namespace

GalerkinProblem stage_problem(const Scene& scene, const GalerkinProblem& like, IntervalRule rule) {
  const DenseDynamics d = to_dense(scene.dynamics);
  const Matrix M = to_dense(scene.M), entry = source_matrix(scene, d);
  const Tableau t = tableau(rule);
  const Index m = d.A.rows(), n = d.B.cols();
  GalerkinProblem p = like;
  p.runs.clear();
  GalerkinSources sources(scene, d, entry, scene.breakpoints);
  Vector g(n);
  for (const GalerkinRun& run : like.runs) {
    const double h = (like.t[run.first + run.count] - like.t[run.first]) / double(run.count);
    const Stages X = stages(t, d, entry, h);
    p.runs.push_back({run.first, run.count, stage_step(X, t, d, M)});
    const Matrix push_q = seen(d.N, t, X.push);
    for (Index k = run.first; k < run.first + run.count; ++k) {
      const Vector f = stage_sources(scene, rule, t, p.t[k], h, sources);
      p.forcing.row(k) = (X.push.bottomRows(m) * f).transpose();
      p.q.row(k) = (push_q * f).transpose();
      for (Index i = 0; i < 2 && scene.g; ++i) {
        const Index stage = std::min(i, t.c.size() - 1);
        scene.g(p.t[k] + std::min(t.c[stage], 1 - just_before) * h, g);
        p.q.row(k).segment(i * n, n) += t.weights[stage] * g.transpose();
      }
    }
  }
  return p;
}

RuledProblems::RuledProblems(const Scene& scene, const GalerkinProblem& p)
    : ByRule{p, stage_problem(scene, p, IntervalRule::radau), stage_problem(scene, p, IntervalRule::euler)} {}

GalerkinProblem mixed_problem(const RuledProblems& problems, const std::vector<IntervalRule>& rules) {
  const GalerkinProblem& like = problems.galerkin;
  GalerkinProblem p = like;
  p.runs.clear();
  for (std::size_t r = 0; r < like.runs.size(); ++r)
    for (Index k = like.runs[r].first; k < like.runs[r].first + like.runs[r].count; ++k) {
      const IntervalRule rule = rules[std::size_t(k)];
      const GalerkinProblem& from = problems.by(rule);
      p.forcing.row(k) = from.forcing.row(k);
      p.q.row(k) = from.q.row(k);
      if (k == like.runs[r].first || rule != rules[std::size_t(k - 1)]) p.runs.push_back({k, 0, from.runs[r].step});
      ++p.runs.back().count;
    }
  return p;
}

RuleChoice::RuleChoice(const Scene& scene)
    : n_(scene.constraints()), free_rows_(scene.free_rows), M_(to_dense(scene.M)), breakpoints_(scene.breakpoints) {
  const DenseDynamics d = to_dense(scene.dynamics);
  NB_ = d.N * d.B;
  for (Index i = 0; i < n_; ++i)
    if (!std::binary_search(free_rows_.begin(), free_rows_.end(), i)) bound_rows_.push_back(i);
  if (free_rows_.empty()) return;
  const Matrix block = M_(free_rows_, free_rows_);
  const Eigen::PartialPivLU<Matrix> lu(scaled(block, equilibrate(block)));
  free_block_is_regular_ = reciprocal_condition(lu) > singular_block;
}

bool RuleChoice::source_jumps(double begin, double end) const {
  const double apart = just_before * (end - begin);
  const auto first = std::lower_bound(breakpoints_.begin(), breakpoints_.end(), begin + apart);
  return first != breakpoints_.end() && *first < end - apart;
}

IntervalRule RuleChoice::needed(const Vector& z) {
  std::vector<Index> S;
  const bool reduced = z.size() < 2 * n_;
  for (std::size_t i = 0; i < bound_rows_.size(); ++i) {
    const Index at = reduced ? Index(i) : bound_rows_[i];
    if (z[at] > 0 || z[z.size() / 2 + at] > 0) S.push_back(bound_rows_[i]);
  }
  if (S.empty()) return IntervalRule::galerkin;
  const auto known = known_.find(S);
  if (known != known_.end()) return known->second;
  return known_[S] = decide(S);
}

// On the null space of M_SS, from the left U and from the right V, y acts on w' through U^T N B V. Where that has the
// rank of N and B there, y follows from w' = 0; otherwise from a later derivative.
IntervalRule RuleChoice::decide(const std::vector<Index>& active) const {
  std::vector<Index> S = active;
  if (free_block_is_regular_) S.insert(S.end(), free_rows_.begin(), free_rows_.end());
  const Matrix block = M_(S, S);
  const Equilibration scale = equilibrate(block);
  const Eigen::JacobiSVD<Matrix> svd(scale.rows.asDiagonal() * block * scale.columns.asDiagonal(),
                                     Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector& sizes = svd.singularValues();
  Index rank = 0;
  while (rank < sizes.size() && sizes[rank] > singular_block * std::max(sizes[0], 1e-300)) ++rank;
  const Index null = Index(S.size()) - rank;
  if (null == 0) return IntervalRule::galerkin;
  const Matrix U = scale.rows.asDiagonal() * svd.matrixU().rightCols(null),
               V = scale.columns.asDiagonal() * svd.matrixV().rightCols(null);
  const Matrix first = U.transpose() * NB_(S, S) * V;
  const Eigen::FullPivLU<Matrix> lu(scaled(first, equilibrate(first)));
  const double largest = lu.maxPivot();
  Index regular = 0;
  for (Index i = 0; i < null; ++i) regular += std::abs(lu.matrixLU()(i, i)) > lost_rank * largest;
  return largest > 0 && regular == null ? IntervalRule::radau : IntervalRule::euler;
}

bool lets_go(const Vector& z) {
  const Index n = z.size() / 2;
  const double zero = 1e-9 * z.cwiseAbs().maxCoeff();
  for (Index i = 0; i < n; ++i)
    if (z[i] > zero && !(z[n + i] > zero)) return true;
  return false;
}

std::vector<IntervalRule> next_rules(const RuledProblems& problems, RuleChoice& choice,
                                     const std::vector<IntervalRule>& rules, const RowMatrix& z, bool keep) {
  const GalerkinProblem& p = problems.galerkin;
  std::vector<IntervalRule> next(std::size_t(p.N), IntervalRule::galerkin);
  for (Index k = 0; k < p.N; ++k) {
    const IntervalRule now = rules[std::size_t(k)];
    const Vector values = z.row(k).transpose();
    IntervalRule rule = choice.needed(values);
    if (rule == IntervalRule::radau && choice.source_jumps(p.t[k], p.t[k + 1])) rule = IntervalRule::euler;
    const bool jump = now == IntervalRule::radau && lets_go(values);
    // An interval of Euler shows no jump any more.
    if (jump || (now == IntervalRule::euler && rule != IntervalRule::galerkin)) rule = IntervalRule::euler;
    if (keep) rule = std::max(rule, now);
    next[std::size_t(k)] = rule;
  }
  return next;
}

ReducedProblems::ReducedProblems(const RuledProblems& p, const std::vector<Index>& free_rows)
    : ByRule{{p.galerkin, free_rows}, {p.radau, free_rows}, {p.euler, free_rows}} {}

std::string describe(const std::vector<IntervalRule>& rules) {
  const auto radau = std::count(rules.begin(), rules.end(), IntervalRule::radau),
             euler = std::count(rules.begin(), rules.end(), IntervalRule::euler);
  std::string words;
  if (radau > 0) words += text("; %ld intervals by Radau IIA", long(radau));
  if (euler > 0) words += text("; %ld by implicit Euler", long(euler));
  return words;
}

}  // namespace bromwich
