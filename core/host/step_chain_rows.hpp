#pragma once
// Shared by chains of dense and of sparse maps: products of rows grouped by matrix, and products of maps for the exact
// parallel adjoints. Notation of core/host/step_chain.hpp; rows are row vectors here,
//
//     mu_i^T = q_i^T + mu_{i+1}^T (I + D_{i+1}).

#include "step_chain.hpp"

#include <vector>

namespace bromwich::host {

/// Places 0 .. count-1 sorted by their matrix and cut into tiles, one matrix each.
struct PlaceTiles {
  struct Tile {
    Index matrix, first, count;  ///< places order[first .. first+count)
    bool adjacent;               ///< the places are consecutive
  };
  std::vector<Index> order;
  std::vector<Tile> tiles;

  PlaceTiles() = default;
  PlaceTiles(const std::vector<Index>& matrix_of, Index matrices, Index most);
};

/// Square matrices of one size, rows contiguous.
class MatrixList {
 public:
  using View = Eigen::Map<RowMatrix>;
  using ConstView = Eigen::Map<const RowMatrix>;

  MatrixList() = default;
  MatrixList(Index count, Index m) : m_(m), values_(Vector::Zero(count * m * m)) {}
  Index count() const { return m_ == 0 ? 0 : values_.size() / (m_ * m_); }
  Index size() const { return m_; }
  View operator[](Index k) { return {values_.data() + k * m_ * m_, m_, m_}; }
  ConstView operator[](Index k) const { return {values_.data() + k * m_ * m_, m_, m_}; }
  std::size_t bytes() const { return sizeof(double) * std::size_t(values_.size()); }

 private:
  Index m_ = 0;
  Vector values_;  ///< Eigen-aligned: the rounding of a product depends on alignment
};

/// Rows of place p: p + in is read, p + out is written and added.
struct RowShift {
  Index in = 0, out = 0;
};

/// The factor made of the matrix X of a place.
enum class Factor { plain, transposed, plus_identity };  ///< X, X^T, I + X

/// out <- add + in F with the factor F of each place. `out` may be `in` if the shifts agree.
void multiply_places(const PlaceTiles&, const MatrixList& X, Factor, const RowMatrix& in, const RowMatrix* add,
                     RowMatrix& out, RowShift, const HostThreads& threads);

/// Calls use(tile, places of the tile, a workspace) for all tiles, concurrently.
template <class Workspace, class Use>
void each_tile(const PlaceTiles& places, const HostThreads& threads, Index together, const Use& use) {
  const Index tiles = Index(places.tiles.size());
  share(threads, tiles, together, [&](Index first, Index last) {
    Workspace workspace;
    for (Index t = first; t < last; ++t) {
      const PlaceTiles::Tile& tile = places.tiles[std::size_t(t)];
      use(tile, places.order.data() + tile.first, workspace);
    }
  });
}

/// Adjoints mu of a chain by products of its maps. `D`: increments by kind. Throws Error above the memory limit.
void solve_by_doubling(const MatrixList& D, const std::vector<Index>& map_of, double memory_limit, RowMatrix& mu,
                       const HostThreads& threads);
void solve_by_scan(const MatrixList& D, const std::vector<Index>& map_of, double memory_limit, RowMatrix& mu,
                   const HostThreads& threads);

/// Factors made of one map.
enum class RowFactor { inverse, R, R_transposed, change_transposed };  ///< S^{-1}, R, R^T, (R - S)^T

/// The part of a chain that does not depend on the storage of its maps.
class HostStepChain : public StepChain {
 public:
  HostStepChain(const StepChainProblem&, const HostThreads& threads);
  RowMatrix solve(RowMatrix d) final;
  RowMatrix solve_transposed(RowMatrix q, const AdjointChoice&) final;
  Vector weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) final;
  Vector locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                   const RowMatrix& l) final;

 protected:
  /// x and l have the sizes of d and q; their values are overwritten. They may be the same objects as d and q.
  virtual void forward(const RowMatrix& d, RowMatrix& x) = 0;
  virtual void substitute(const RowMatrix& q, RowMatrix& l) = 0;
  /// next_i = q_i + P_{i+1}^T mu_{i+1} for i < M.
  virtual void carry(const RowMatrix& q, const RowMatrix& mu, RowMatrix& next) = 0;
  /// l_i = S_i^{-T} mu_i for i >= 1, in place.
  virtual void finish(RowMatrix& mu) = 0;
  /// out <- in F for rows with the same kind of step. Called concurrently.
  using Rows = Eigen::Ref<RowMatrix, 0, Eigen::OuterStride<>>;
  virtual void apply(Index kind, RowFactor, const Rows& in, Rows out) = 0;
  /// D by kind. `method` names the caller in errors.
  virtual const MatrixList& increments(const char* method) = 0;

  /// Buffers for rows processed together.
  struct Panel {
    Panel(Index rows, Index m) : out(rows, m) {}
    RowMatrix in, out, r;
  };
  /// out_k <- in_k F with F of step `first + k stride`; steps count from 0.
  void apply_steps(Index first, Index stride, RowFactor, RowMatrix& in, Index count, RowMatrix& out);
  /// The residuals of these steps, in p.r.
  void residual_rows(const RowMatrix& d, const RowMatrix& x, Index first, Index stride, Index count, Panel& p);

  void adjoint(const RowMatrix& q, RowMatrix& l, const AdjointChoice&);

  Index M_, m_;
  std::vector<Index> map_of_;
  std::vector<char> plain_R_;  ///< whether R = I, by kind
  double memory_limit_;
  const HostThreads& threads_;
  RowMatrix other_;  ///< buffer of Jacobi sweeps
};

std::unique_ptr<StepChain> make_dense_step_chain(const StepChainProblem&, const HostThreads& threads);
std::unique_ptr<StepChain> make_sparse_step_chain(const StepChainProblem&, const HostThreads& threads);

}  // namespace bromwich::host
