// Chains of sparse maps: one LU factorization with partial pivoting per kind of step. Rows of a space-time array are
// contiguous, so rows of one kind form the columns of a system with many right-hand sides.

#include "core/host/sparse_step_factors.hpp"
#include "core/host/step_chain_rows.hpp"

#include <algorithm>

namespace bromwich::host {

namespace {

constexpr Index sparse_tile_rows = 16;

class SparseStepChain final : public HostStepChain {
 public:
  SparseStepChain(const StepChainProblem& problem, const HostThreads& threads)
      : HostStepChain(problem, threads),
        places_(map_of_, Index(problem.maps.size()), sparse_tile_rows),
        kinds_(problem.maps.size()) {
    const Index kinds = Index(kinds_.size());
    share_each(threads, kinds, [&](Index k) {
      kinds_[std::size_t(k)] = std::make_unique<SparseStepFactors>(problem.maps[std::size_t(k)]);
    });
    for (Index k = 0; k < kinds; ++k)
      if (kinds_[std::size_t(k)]->singular) throw singular_step(problem, k);
  }

  std::size_t bytes() const override {
    std::size_t sum = D_.bytes() + sizeof(Index) * 2 * map_of_.size() + sizeof(double) * std::size_t(other_.size());
    for (const auto& kind : kinds_)
      sum += (sizeof(double) + sizeof(int)) *
             std::size_t(kind->lu.nnzL() + kind->lu.nnzU() + kind->R.nonZeros() + kind->change.nonZeros());
    return sum;
  }

 private:
  SparseStepFactors& step(Index i) { return *kinds_[std::size_t(map_of_[std::size_t(i - 1)])]; }

  // x_i = x_{i-1} + S^{-1} (d_i + (R - S) x_{i-1}): the solved part is small, and so is its rounding error.
  void forward(const RowMatrix& d, RowMatrix& x) override {
    x.row(0) = d.row(0);
    Vector right(m_), solved(m_);
    for (Index i = 1; i <= M_; ++i) {
      right = d.row(i).transpose();
      right += step(i).change * x.row(i - 1).transpose();
      solved = step(i).lu.solve(right);
      x.row(i) = x.row(i - 1) + solved.transpose();
    }
  }

  // mu_{i-1} = q_{i-1} + R^T l_i = mu_i + (q_{i-1} + (R - S)^T l_i) with mu_i = S^T l_i.
  void substitute(const RowMatrix& q, RowMatrix& l) override {
    Vector mu = q.row(M_).transpose(), added(m_), solved(m_);
    for (Index i = M_; i >= 1; --i) {
      solved = step(i).solve_transposed(mu);
      l.row(i) = solved.transpose();
      added = q.row(i - 1).transpose();
      added += step(i).change.transpose() * solved;
      mu += added;
    }
    l.row(0) = mu.transpose();
  }

  // The rows p + in of the places p of a tile, as columns.
  struct Columns {
    Matrix values, changed;
    void gather(const RowMatrix& in, const PlaceTiles::Tile& tile, const Index* order, Index shift) {
      values.resize(in.cols(), tile.count);
      for (Index k = 0; k < tile.count; ++k) values.col(k) = in.row(order[k] + shift).transpose();
    }
  };
  template <class Use>
  void each_kind(const Use& use) {
    each_tile<Columns>(places_, threads_, 1, [&](const PlaceTiles::Tile& tile, const Index* order, Columns& columns) {
      use(*kinds_[std::size_t(tile.matrix)], tile, order, columns);
    });
  }

  void carry(const RowMatrix& q, const RowMatrix& mu, RowMatrix& next) override {
    each_kind([&](SparseStepFactors& kind, const PlaceTiles::Tile& tile, const Index* order, Columns& columns) {
      columns.gather(mu, tile, order, 1);
      columns.changed.noalias() = kind.change.transpose() * kind.solve_transposed(columns.values);
      for (Index k = 0; k < tile.count; ++k)
        next.row(order[k]) = q.row(order[k]) + (columns.changed.col(k) + columns.values.col(k)).transpose();
    });
  }

  void finish(RowMatrix& mu) override {
    each_kind([&](SparseStepFactors& kind, const PlaceTiles::Tile& tile, const Index* order, Columns& columns) {
      columns.gather(mu, tile, order, 1);
      columns.changed = kind.solve_transposed(columns.values);
      for (Index k = 0; k < tile.count; ++k) mu.row(order[k] + 1) = columns.changed.col(k).transpose();
    });
  }

  void apply(Index kind, RowFactor factor, const Rows& in, Rows out) override {
    SparseStepFactors& step = *kinds_[std::size_t(kind)];
    const Matrix columns = in.transpose();
    switch (factor) {
      case RowFactor::inverse:
        out = step.solve_transposed(columns).transpose();
        return;
      case RowFactor::R:
        out = (step.R.transpose() * columns).transpose();
        return;
      case RowFactor::R_transposed:
        out = (step.R * columns).transpose();
        return;
      case RowFactor::change_transposed:
        out = (step.change * columns).transpose();
    }
  }

  const MatrixList& increments(const char* method) override {
    const Index kinds = Index(kinds_.size());
    if (D_.count() == kinds) return D_;
    check_products(8.0 * double(m_ * m_) * double(kinds), memory_limit_, method);
    D_ = MatrixList(kinds, m_);
    share_each(threads_, kinds, [&](Index k) {
      SparseStepFactors& kind = *kinds_[std::size_t(k)];
      const Matrix D = kind.lu.solve(Matrix(kind.change));
      D_[k] = D;
    });
    return D_;
  }

  PlaceTiles places_;
  std::vector<std::unique_ptr<SparseStepFactors>> kinds_;
  MatrixList D_;
};

}  // namespace

std::unique_ptr<StepChain> make_sparse_step_chain(const StepChainProblem& problem, const HostThreads& threads) {
  return std::make_unique<SparseStepChain>(problem, threads);
}

}  // namespace bromwich::host
