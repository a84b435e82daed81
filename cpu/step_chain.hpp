#pragma once
// What chains of dense and of sparse maps share: rows that meet the same matrix, taken together, and the products of
// maps for the exact parallel adjoints. Notation of core/step_chain.hpp; rows are row vectors here,
//
//     mu_i^T = q_i^T + mu_{i+1}^T P_{i+1}.

#include "core/step_chain.hpp"
#include "cpu/parts.hpp"

#include <vector>

namespace bromwich::cpu {

/// Places 0 .. count-1 in the order of the matrix that they meet, cut into tiles of one matrix each.
struct PlaceTiles {
  struct Tile {
    Index matrix, first, count;  ///< places order[first .. first+count)
    bool adjacent;               ///< they follow each other
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
  MatrixList(Index count, Index m) : m_(m), values_(std::size_t(count * m * m)) {}
  Index count() const { return m_ == 0 ? 0 : Index(values_.size()) / (m_ * m_); }
  Index size() const { return m_; }
  View operator[](Index k) { return {values_.data() + k * m_ * m_, m_, m_}; }
  ConstView operator[](Index k) const { return {values_.data() + k * m_ * m_, m_, m_}; }
  std::size_t bytes() const { return sizeof(double) * values_.size(); }

 private:
  Index m_ = 0;
  std::vector<double> values_;
};

/// The rows that a place p reads and writes: in p + in, out p + out, and what is added p + out too.
struct RowShift {
  Index in = 0, out = 0;
};

/// out <- add + in X (or in X^T), X the matrix of each place. `out` may be `in` where the shifts agree.
void multiply_places(const PlaceTiles&, const MatrixList& X, bool transposed, const RowMatrix& in, const RowMatrix* add,
                     RowMatrix& out, RowShift, int threads);

/// mu of a chain by products of its maps. `P` holds the P_i by kind.
void solve_by_doubling(const MatrixList& P, const std::vector<Index>& map_of, double memory_limit, RowMatrix& mu,
                       int threads);
void solve_by_scan(const MatrixList& P, const std::vector<Index>& map_of, double memory_limit, RowMatrix& mu,
                   int threads);

/// The adjoint, but for what depends on how the maps are stored.
class CpuStepChain : public StepChain {
 public:
  CpuStepChain(const StepChainProblem&, int threads);
  void forward(const Array& d, Array& x) final;
  void adjoint(const Array& q, Array& l, const AdjointChoice&) final;

 protected:
  virtual void forward(const RowMatrix& d, RowMatrix& x) = 0;
  virtual void substitute(const RowMatrix& q, RowMatrix& l) = 0;
  /// next_i = q_i + P_{i+1}^T mu_{i+1} for i < M.
  virtual void sweep(const RowMatrix& q, const RowMatrix& mu, RowMatrix& next) = 0;
  /// l_i = S_i^{-T} mu_i for i >= 1, in place.
  virtual void finish(RowMatrix& mu) = 0;
  /// P by kind.
  virtual const MatrixList& transitions(const char* method) = 0;

  Index M_, m_;
  std::vector<Index> map_of_;
  double memory_limit_;
  int threads_;
  RowMatrix other_;  ///< of sweeps
};

std::unique_ptr<StepChain> make_dense_step_chain(const StepChainProblem&, int threads);
std::unique_ptr<StepChain> make_sparse_step_chain(const StepChainProblem&, int threads);

}  // namespace bromwich::cpu
