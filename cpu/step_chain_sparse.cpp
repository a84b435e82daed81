// Chains of sparse maps: one LU factorization with partial pivoting for every kind of step. Rows of a space-time array
// are contiguous, so rows of one kind are the columns of a system with many right-hand sides.

#include "cpu/step_chain.hpp"

#include <Eigen/SparseLU>

#include <algorithm>

namespace bromwich::cpu {

namespace {

constexpr Index sparse_tile_rows = 16;

struct SparseStep {
  explicit SparseStep(const StepMap& map) : R(std::get<SparseMatrix>(map.R)), S(std::get<SparseMatrix>(map.S)) {
    S.makeCompressed();
    R.makeCompressed();
    lu.compute(S);
  }
  bool singular() const { return lu.info() != Eigen::Success; }

  // S^{-T}, without changing what is shared: the view that Eigen offers is a small object of its own.
  template <class In>
  Matrix solve_transposed(const In& b) {
    return lu.transpose().solve(b);
  }

  SparseMatrix R, S;
  Eigen::SparseLU<SparseMatrix> lu;
};

class SparseStepChain final : public CpuStepChain {
 public:
  SparseStepChain(const StepChainProblem& problem, int threads)
      : CpuStepChain(problem, threads),
        places_(map_of_, Index(problem.maps.size()), sparse_tile_rows),
        kinds_(problem.maps.size()) {
    const Index kinds = Index(kinds_.size());
#pragma omp parallel for num_threads(threads) schedule(dynamic, 1)
    for (Index k = 0; k < kinds; ++k)
      kinds_[std::size_t(k)] = std::make_unique<SparseStep>(problem.maps[std::size_t(k)]);
    for (Index k = 0; k < kinds; ++k)
      if (kinds_[std::size_t(k)]->singular()) throw singular_step(problem, k);
  }

  std::size_t bytes() const override {
    std::size_t sum = P_.bytes() + sizeof(Index) * 2 * map_of_.size() + sizeof(double) * std::size_t(other_.size());
    for (const auto& kind : kinds_)
      sum += (sizeof(double) + sizeof(int)) *
             std::size_t(kind->lu.nnzL() + kind->lu.nnzU() + kind->R.nonZeros() + kind->S.nonZeros());
    return sum;
  }

 private:
  SparseStep& step(Index i) { return *kinds_[std::size_t(map_of_[std::size_t(i - 1)])]; }

  void forward(const RowMatrix& d, RowMatrix& x) override {
    x.row(0) = d.row(0);
    Vector right(m_), solved(m_);
    for (Index i = 1; i <= M_; ++i) {
      right = d.row(i).transpose();
      right += step(i).R * x.row(i - 1).transpose();
      solved = step(i).lu.solve(right);
      x.row(i) = solved.transpose();
    }
  }

  void substitute(const RowMatrix& q, RowMatrix& l) override {
    Vector mu = q.row(M_).transpose(), solved(m_);
    for (Index i = M_; i >= 1; --i) {
      solved = step(i).solve_transposed(mu);
      l.row(i) = solved.transpose();
      mu = q.row(i - 1).transpose();
      mu += step(i).R.transpose() * solved;
    }
    l.row(0) = mu.transpose();
  }

  // The rows of each tile as columns: `use(kind, columns)` changes them, and they go to row place + out.
  template <class Use>
  void each_tile(const RowMatrix& in, RowMatrix& out, Index shift_out, const RowMatrix* add, const Use& use) {
    const Index tiles = Index(places_.tiles.size());
#pragma omp parallel num_threads(threads_)
    {
      Matrix columns;
#pragma omp for schedule(dynamic, 1)
      for (Index t = 0; t < tiles; ++t) {
        const PlaceTiles::Tile& tile = places_.tiles[std::size_t(t)];
        columns.resize(m_, tile.count);
        const Index* order = places_.order.data() + tile.first;
        for (Index r = 0; r < tile.count; ++r) columns.col(r) = in.row(order[r] + 1).transpose();
        use(*kinds_[std::size_t(tile.matrix)], columns);
        for (Index r = 0; r < tile.count; ++r) {
          const Index to = order[r] + shift_out;
          out.row(to) = columns.col(r).transpose();
          if (add) out.row(to) += add->row(to);
        }
      }
    }
  }

  void sweep(const RowMatrix& q, const RowMatrix& mu, RowMatrix& next) override {
    each_tile(mu, next, 0, &q, [](SparseStep& kind, Matrix& columns) {
      columns = Matrix(kind.R.transpose() * kind.solve_transposed(columns));
    });
  }

  void finish(RowMatrix& mu) override {
    each_tile(mu, mu, 1, nullptr, [](SparseStep& kind, Matrix& columns) { columns = kind.solve_transposed(columns); });
  }

  const MatrixList& transitions(const char* method) override {
    const Index kinds = Index(kinds_.size());
    if (P_.count() == kinds) return P_;
    check_products(8.0 * double(m_ * m_) * double(kinds), memory_limit_, method);
    P_ = MatrixList(kinds, m_);
#pragma omp parallel for num_threads(threads_) schedule(dynamic, 1)
    for (Index k = 0; k < kinds; ++k) {
      SparseStep& kind = *kinds_[std::size_t(k)];
      const Matrix P = kind.lu.solve(Matrix(kind.R));
      P_[k] = P;
    }
    return P_;
  }

  PlaceTiles places_;
  std::vector<std::unique_ptr<SparseStep>> kinds_;
  MatrixList P_;
};

}  // namespace

std::unique_ptr<StepChain> make_sparse_step_chain(const StepChainProblem& problem, int threads) {
  return std::make_unique<SparseStepChain>(problem, threads);
}

}  // namespace bromwich::cpu
