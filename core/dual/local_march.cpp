#include "core/dual/local_march.hpp"

#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/dual/dual_operator.hpp"
#include "core/dual/stage_weights.hpp"
#include "core/lcp/entries.hpp"
#include "core/march/outcome.hpp"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseLU>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

constexpr Index most_changes = 60;  ///< of the active set in a step, and one for each state: boundaries may move by one
constexpr double rounding = 4 * epsilon;
constexpr double least_pivot = 0.1;  ///< relative to its column: the matrix of a step is nearly definite

// The diagonal of a square matrix without other entries; empty otherwise.
Vector only_diagonal(const SparseMatrix& matrix) {
  if (matrix.rows() != matrix.cols()) return {};
  Vector diagonal = Vector::Zero(matrix.rows());
  for (Index k = 0; k < matrix.outerSize(); ++k)
    for (SparseMatrix::InnerIterator entry(matrix, k); entry; ++entry) {
      if (entry.value() == 0) continue;
      if (entry.row() != entry.col()) return {};
      diagonal[entry.row()] = entry.value();
    }
  return diagonal;
}

SparseMatrix matrix_of_states(const DiscreteProblem& p) {
  if (const SparseDynamics* d = p.scene.dynamics->matrices()) return d->A;
  return p.small_state()->A.sparseView();
}

// (a^{-1}/h ⊗ I - I ⊗ A), stage by stage.
SparseMatrix step_matrix(const SparseMatrix& A, double h) {
  const Index n = A.rows();
  std::vector<Eigen::Triplet<double>> entries;
  for (int a = 0; a < 2; ++a) {
    for (int b = 0; b < 2; ++b)
      for (Index i = 0; i < n; ++i) entries.emplace_back(a * n + i, b * n + i, radau_inverse[a][b] / h);
    for (Index k = 0; k < A.outerSize(); ++k)
      for (SparseMatrix::InnerIterator entry(A, k); entry; ++entry)
        entries.emplace_back(a * n + entry.row(), a * n + entry.col(), -entry.value());
  }
  SparseMatrix matrix(2 * n, 2 * n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

// Minimum degree of a pattern that is symmetric. SparseLU takes the inverse of what AMDOrdering gives.
struct SymmetricOrdering {
  using PermutationType = Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, SparseMatrix::StorageIndex>;
  void operator()(const SparseMatrix& matrix, PermutationType& order) const {
    PermutationType found;
    Eigen::AMDOrdering<SparseMatrix::StorageIndex>()(matrix, found);
    order = found.inverse();
  }
};

// One step: active sets until the signs fit. A factorization is kept as long as its active set.
class LocalStep {
 public:
  LocalStep(const SparseMatrix& A, const Vector& B, const Vector& N, double h)
      : n_(A.rows()),
        B_(B.replicate(2, 1)),
        N_(N.replicate(2, 1)),
        G_(step_matrix(A, h)),
        fixed_(std::size_t(2 * n_), 0) {
    for (auto* lu : {&lu_, &linear_}) lu->setPivotThreshold(least_pivot);
    linear_.compute(G_);
    diagonal_ = G_.diagonal();
    sizes_ = G_.cwiseAbs();
    K_ = G_;
    lu_.analyzePattern(K_);
    factor();
  }

  bool regular() const { return linear_.info() == Eigen::Success; }

  // The problem of a step is positive definite with the quadrature weights 3/4, 1/4 on its rows, so that it is P.
  bool well_posed() const {
    Vector rows = B_.cwiseInverse();
    rows.head(n_) *= 0.75;
    rows.tail(n_) *= 0.25;
    const SparseMatrix V = rows.asDiagonal() * G_ * N_.cwiseInverse().asDiagonal();
    const SparseMatrix symmetric = V + SparseMatrix(V.transpose());
    return Eigen::SimplicialLLT<SparseMatrix>(symmetric).info() == Eigen::Success;
  }

  // X and y of both stages; `known` is the right-hand side without y. False: the signs do not settle.
  bool solve(const Vector& known, const Vector& g, Vector& X, Vector& y, LcpCount& count) {
    for (Index change = 0; change < most_changes + n_; ++change, ++count.newton) {
      Vector rhs = known;
      for (Index i = 0; i < 2 * n_; ++i)
        if (fixed_[std::size_t(i)]) rhs[i] = -diagonal_[i] * g[i] / N_[i];
      X = lu_.solve(rhs);
      if (lu_.info() != Eigen::Success || !X.allFinite()) return false;
      y = (G_ * X - known).cwiseQuotient(B_);
      if (!exchange(X, g, known, y)) {
        for (Index i = 0; i < 2 * n_; ++i) y[i] = fixed_[std::size_t(i)] ? std::max(y[i], 0.0) : 0;
        ++count.solved;
        return true;
      }
      factor();
      if (lu_.info() != Eigen::Success) return false;
    }
    ++count.unsolved;
    return false;
  }

  // X that these y lead to.
  Vector driven(const Vector& known, const Vector& y) const { return linear_.solve(known + y.cwiseProduct(B_)); }

  std::size_t bytes() const { return std::size_t(60 * G_.nonZeros()); }

 private:
  void factor() {
    for (Index k = 0; k < K_.outerSize(); ++k)
      for (SparseMatrix::InnerIterator to(K_, k), from(G_, k); to; ++to, ++from)
        to.valueRef() = fixed_[std::size_t(to.row())] && to.row() != to.col() ? 0 : from.value();
    lu_.factorize(K_);
  }

  // Releases where y < 0 and fixes where w < 0, beyond rounding; whether something changed. The rounding of X is that
  // of its largest values: where payoffs vanish, w is far smaller.
  bool exchange(const Vector& X, const Vector& g, const Vector& known, const Vector& y) {
    const Vector products = sizes_ * X.cwiseAbs() + known.cwiseAbs();
    const double size_of_X = X.cwiseAbs().maxCoeff();
    bool changed = false;
    for (Index i = 0; i < 2 * n_; ++i) {
      char& fixed = fixed_[std::size_t(i)];
      const bool wrong = fixed ? B_[i] * y[i] < -rounding * products[i]
                               : N_[i] * X[i] + g[i] < -rounding * (N_[i] * size_of_X + std::abs(g[i]));
      if (wrong) fixed = !fixed;
      changed = changed || wrong;
    }
    return changed;
  }

  Index n_;
  Vector B_, N_, diagonal_;
  SparseMatrix G_, K_, sizes_;  ///< sizes_: |G|
  std::vector<char> fixed_;
  Eigen::SparseLU<SparseMatrix, SymmetricOrdering> lu_, linear_;
};

class LocalMarch final : public PreparedMethod {
 public:
  explicit LocalMarch(const DiscreteProblem& p)
      : p_(p),
        A_(matrix_of_states(p)),
        B_(only_diagonal(p.scene.dynamics->inputs())),
        N_(only_diagonal(p.scene.dynamics->outputs())),
        at_zero_(p) {}

  void renew(const Changes&) override { at_zero_.renew(); }

  void run(const Options& options, Result& result) override {
    Timer timer;
    Vector y0;
    const Start start = at_zero_.solve(result, y0);
    if (start == Start::none) return;
    if (start == Start::impulse) {
      result.status = Status::unsupported;
      result.reason = "x0 violates the constraints, and steps in w do not take a jump of the state; use method march";
      return;
    }
    const Index n = p_.scene.constraints(), J = p_.J;
    const RowMatrix g = one_sided(stage_values(p_, p_.scene.g, p_.g)),
                    phi = p_.f.size() > 0 ? in_one_piece(stage_values(p_, p_.scene.f, p_.f)) : RowMatrix();
    const SparseMatrix F = phi.size() > 0 ? entry_of_sources(p_.scene) : SparseMatrix();
    LocalStep step(A_, B_, N_, p_.h);
    result.form = "dual";
    result.kernel = "steps in w: V is local, Radau IIA with the sparse matrix of the dynamics";
    result.continuous = false;
    result.y = RowMatrix::Constant(J + 1, n, NAN);
    result.y_integral = RowMatrix::Zero(J + 1, n);
    result.x.resize(J + 1, Index(p_.components.size()));
    RowMatrix seen(J + 1, n);
    result.y.row(0) = y0.transpose();
    Vector x = p_.scene.x0, X, y;
    seen.row(0) = x.cwiseProduct(N_).transpose();
    record(x, 0, result);
    result.residual = 0;
    result.bytes += host_bytes(p_) + step.bytes();
    result.iterations = 1;
    result.well_posed = step.well_posed();
    for (Index j = 1; j <= J; ++j) {
      if (options.interrupted && options.interrupted()) return stop(j, Status::interrupted, why_interrupted(), result);
      Vector known(2 * n);
      for (int a = 0; a < 2; ++a) {
        known.segment(a * n, n) = (radau_inverse_ones[a] / p_.h) * x;
        if (phi.size() > 0) known.segment(a * n, n) += F * phi.row(j).segment(a * F.cols(), F.cols()).transpose();
      }
      const Vector given = g.row(j).transpose();
      if (!step.regular() || !step.solve(known, given, X, y, result.lcp))
        return stop(j, Status::tolerance_not_met,
                    text("the problem of the step to t = %.6g stayed unsolved; use method march", p_.t[j]), result);
      X = step.driven(known, y);  // the pair that is judged: y, and w from the states that it gives
      const Vector w = X.cwiseProduct(N_.replicate(2, 1)) + given;
      const double missed = w.cwiseMin(y).cwiseAbs().maxCoeff() / std::max(1.0, w.cwiseAbs().maxCoeff());
      result.residual = missed <= result.residual ? result.residual : missed;
      x = X.tail(n);
      seen.row(j) = x.cwiseProduct(N_).transpose();
      result.y.row(j) = y.tail(n).transpose();
      if (p_.sources && p_.sources->at(j) && !after_jump(j, seen.row(j), result)) return;
      result.y_integral.row(j) =
          result.y_integral.row(j - 1) + p_.h * (0.75 * y.head(n) + 0.25 * y.tail(n)).transpose();
      record(x, j, result);
    }
    if (options.trace) result.trace = seen;
    result.seconds.lcp += timer.lap();
    result.status = Status::solved;
  }

 private:
  void record(const Vector& x, Index j, Result& result) const {
    for (std::size_t c = 0; c < p_.components.size(); ++c) result.x(j, Index(c)) = x[p_.components[c]];
  }

  // At the ends of steps where g jumps, its limit from the left: the step ends before the jump.
  RowMatrix one_sided(RowMatrix g) const {
    if (!p_.sources || !p_.scene.g) return g;
    const Index n = p_.scene.constraints();
    const OneSided source(p_.scene.g, n, p_.sources->resolution);
    for (const RoughStep& rough : p_.sources->rough)
      g.row(rough.step).tail(n) = source.whole(source.before(p_.t[rough.step], p_.h)).transpose();
    return g;
  }

  // f on steps that end at a breakpoint: their polynomial.
  RowMatrix in_one_piece(RowMatrix phi) const {
    if (!p_.sources) return phi;
    const Index width = phi.cols() / 2;
    for (const RoughStep& rough : p_.sources->rough) {
      if (rough.pieces.empty()) continue;
      const Matrix& c = rough.pieces[0].phi;
      for (int a = 0; a < 2; ++a) {
        const double sigma = a == 0 ? 1.0 / 3 : 1;
        const Vector value = c * Vector{{1, sigma, sigma * sigma}};
        const Vector whole = p_.f.shapes().size() > 0 ? Vector(p_.f.shapes() * value) : value;
        phi.row(rough.step).segment(a * width, width) = whole.transpose();
      }
    }
    return phi;
  }

  // y at the point itself, after a jump of g: 0 where the jump opens a gap. A jump that closes one moves the state.
  bool after_jump(Index j, const RowMatrix& trace, Result& result) const {
    const Vector own = trace.transpose() + p_.g.row(j);
    const double size = rounding * (own.cwiseAbs().maxCoeff() + p_.g.row(j).cwiseAbs().maxCoeff());
    if (own.minCoeff() < -16 * size) {
      stop(j + 1, Status::unsupported,
           text("g falls below the state at t = %.6g, and steps in w do not take a jump of the state; use method march",
                p_.t[j]),
           result);
      return false;
    }
    for (Index i = 0; i < own.size(); ++i)
      if (own[i] > size) result.y(j, i) = 0;
    return true;
  }

  void stop(Index j, Status status, const std::string& reason, Result& result) const {
    result.status = status;
    result.reason = reason;
    for (RowMatrix* rows : {&result.y, &result.y_integral, &result.x}) rows->bottomRows(p_.J + 1 - j).setConstant(NAN);
  }

  const DiscreteProblem& p_;
  SparseMatrix A_;
  Vector B_, N_;
  ProblemAtZero at_zero_;
};

}  // namespace

bool has_local_inverse(const Scene& scene) {
  const LinearSystem& d = *scene.dynamics;
  if (!(d.matrices() || d.small_state()) || d.has_mass() || scene.boundary || !scene.free_rows.empty()) return false;
  if (scene.constraints() != scene.states() || scene.states() <= most_recorded_by_dual) return false;
  const Vector B = only_diagonal(d.inputs()), N = only_diagonal(d.outputs());
  return B.size() > 0 && N.size() > 0 && (B.array() * N.array() > 0).all() && (N.array() > 0).all() && is_zero(scene.M);
}

bool has_local_inverse(const DiscreteProblem& p) {
  const auto at_its_end = [](const RoughStep& step) { return step.ends.size() <= 1 && step.pieces.size() <= 1; };
  return (!p.sources || std::all_of(p.sources->rough.begin(), p.sources->rough.end(), at_its_end)) &&
         has_local_inverse(p.scene);
}

std::unique_ptr<PreparedMethod> prepare_local_march(const DiscreteProblem& p) {
  return std::make_unique<LocalMarch>(p);
}

}  // namespace bromwich
