#include "core/scan/stage_pieces.hpp"

#include "core/host/stage_stepper.hpp"
#include "core/scan/source_numbers.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr double not_touching = 1e-9;  ///< as that of core/host/stage_steps.cpp

// M once for each stage, and the weights D.
Matrix weighted_stages(const Matrix& M, const Matrix& implicit, const Vector& weights) {
  const Index n = M.rows();
  Matrix W = implicit;
  for (Index i = 0; i < W.rows(); i += n) W.block(i, i, n, n) += M;
  return weights.asDiagonal() * W;
}

class StagePieces {
 public:
  explicit StagePieces(const StageProblem& p)
      : p_(p),
        d_(*(*p.dynamics)->small_state()),
        M_(to_dense(*p.M)),
        m_(d_.A.rows()),
        n_(M_.rows()),
        lengths_(p, p.g.rows()),
        sources_(source_numbers(table())) {
    basis_ = p;
    const Index columns = p.g.cols() + p.phi.cols();
    basis_.g = RowMatrix::Zero(columns, p.g.cols());
    basis_.g.topRows(p.g.cols()).setIdentity();
    basis_.phi = RowMatrix::Zero(p.phi.size() > 0 ? columns : 0, p.phi.cols());
    if (p.phi.size() > 0) basis_.phi.bottomRows(p.phi.cols()).setIdentity();
    for (Index k = 0; k < columns; ++k) rows_.push_back(k);
  }

  /// False: an implicit step or its problem is none that pieces have.
  bool make(PieceMarchProblem& to) {
    ChunkMarchProblem& steps = to.steps;
    steps.m = m_, steps.n = n_;
    steps.continuous = false;
    steps.kinds = Index(lengths_.kinds());
    if (steps.kinds > 128) return false;
    steps.sources = std::move(sources_.numbers);
    steps.substitutes_euler = p_.substitutes_euler;
    for (const Index stages : {2, 1})
      for (Index k = 0; k < steps.kinds; ++k)
        if (!add(stages, lengths_.size(std::size_t(k)), to)) return false;
    if (steps.kinds > 1)
      for (Index j = 0; j < p_.g.rows(); ++j) steps.kind_of.push_back((unsigned char)(lengths_.kind(j)));
    steps.moved = d_.B;
    steps.s0 = p_.x0;
    return true;
  }

  // StageSteps::start.
  void start(const Vector& y0, ChunkMarchProblem& steps) const {
    const Vector g = p_.g.row(0).head(n_).transpose(), seen = d_.N * p_.x0;
    const Vector size = d_.N.cwiseAbs() * p_.x0.cwiseAbs() + g.cwiseAbs();
    steps.regular = y0;
    for (Index i = 0; i < n_; ++i) {
      if (std::abs(seen[i] + g[i]) <= not_touching * size[i]) steps.touching |= 1u << i;
      const double first = d_.N.row(i).dot(d_.B.col(i)), terms = d_.N.row(i).cwiseAbs().dot(d_.B.col(i).cwiseAbs());
      if (M_(i, i) == 0 && std::abs(first) <= not_touching * terms) steps.rigid |= 1u << i;
    }
  }

 private:
  RowMatrix table() const {
    RowMatrix all(p_.g.rows(), p_.g.cols() + p_.phi.cols());
    all.leftCols(p_.g.cols()) = p_.g;
    if (p_.phi.size() > 0) all.rightCols(p_.phi.cols()) = p_.phi;
    return all;
  }

  bool add(Index stages, double h, PieceMarchProblem& to) {
    const host::DenseStageMaps maps = host::dense_stage_maps(basis_, d_, stages, h, rows_);
    Vector weights = Vector::Ones(stages * n_);
    if (stages == 2) weights << Vector::Constant(n_, 0.75), Vector::Constant(n_, 0.25);
    PieceProblem problem{weighted_stages(M_, maps.implicit, weights), LcpClass::unknown, (2 - stages) * n_};
    problem.lcp_class = classify(LcpMatrix(problem.W));
    const bool selects_least_element = stages == 1 && selects_least(p_.lcp_class);
    if (!has_convex_solutions(problem.lcp_class)) return false;
    if (selects_least_element && !has_one_solution(problem.lcp_class)) return false;
    ChunkStep step;
    step.h = h;
    step.see = RowMatrix::Zero(2 * n_, m_);
    step.see.bottomRows(stages * n_) = weights.asDiagonal() * maps.see;
    step.decay = maps.decay;
    step.drive = RowMatrix::Zero(m_, 2 * n_);
    step.drive.rightCols(stages * n_) = maps.drive;
    Matrix of_q = Matrix::Zero(2 * n_, maps.q.rows()), of_f = Matrix::Zero(m_, maps.q.rows());
    of_q.bottomRows(stages * n_) = weights.asDiagonal() * maps.q.transpose();
    if (maps.forcing.size() > 0) of_f = maps.forcing.transpose();
    step.q = of_q * sources_.constant;
    step.of_q = of_q * sources_.of;
    step.f = of_f * sources_.constant;
    step.of_f = of_f * sources_.of;
    step.unit = Vector::Ones(2 * n_);
    to.steps.steps.push_back(std::move(step));
    to.problems.push_back(std::move(problem));
    return true;
  }

  const StageProblem& p_;
  StageProblem basis_;  ///< whose rows are those of the identity
  const DenseDynamics& d_;
  const Matrix M_;
  const Index m_, n_;
  host::Lengths lengths_;
  SourceNumbers sources_;
  std::vector<Index> rows_;
};

}  // namespace

std::optional<StageSolution> march_stages_by_pieces(const StageProblem& p, const Vector& y0, const ScanPlan& plan,
                                                    const SharedStop& stop, ScanReport& report) {
  const Index m = p.x0.size(), n = y0.size(), J = p.g.rows() - 1;
  if (p.stages != 2 || p.modal || p.poles || p.jumps_at_start || !y0.allFinite()) return std::nullopt;
  if (m > 16 || 2 * n > 16 || Index(p.components.size()) != m || !(*p.dynamics)->small_state()) return std::nullopt;
  PieceMarchProblem problem;
  StagePieces maker(p);
  if (!maker.make(problem)) return std::nullopt;
  maker.start(y0, problem.steps);
  problem.steps.wants_impulse = true;
  PieceMarch found = march_by_pieces(std::move(problem), plan, stop);
  if (!found.march) return std::nullopt;
  report = std::move(found.report);
  StageSolution s;
  const DenseDynamics& d = *(*p.dynamics)->small_state();
  for (RowMatrix* values : {&s.y, &s.impulse, &s.v}) values->resize(J + 1, n);
  s.x.resize(J + 1, m);
  found.march->download(found.march->y(), s.y);
  found.march->download(*found.march->impulse(), s.impulse);
  found.march->download(found.march->x(), s.x);
  s.y.row(0) = y0.transpose();
  s.impulse.row(0).setZero();
  s.x.row(0) = p.x0.transpose();
  share(*plan.threads, J + 1, 4096, [&](Index begin, Index end) {
    s.v.middleRows(begin, end - begin).noalias() = s.x.middleRows(begin, end - begin) * d.N.transpose();
  });
  s.report.count.solved = long(J);
  s.report.lcp_seconds = report.seconds;
  s.report.jumps = found.march->jumps();
  s.bytes = found.march->bytes();
  return s;
}

}  // namespace bromwich
