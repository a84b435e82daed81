#include "core/host/step_chain_rows.hpp"

#include "core/base/error.hpp"

#include <algorithm>
#include <string>

namespace bromwich::host {

PlaceTiles::PlaceTiles(const std::vector<Index>& matrix_of, Index matrices, Index most) {
  std::vector<Index> end(static_cast<std::size_t>(matrices) + 1, 0);
  for (const Index k : matrix_of) ++end[std::size_t(k) + 1];
  for (std::size_t k = 0; k < std::size_t(matrices); ++k) end[k + 1] += end[k];
  std::vector<Index> next(end.begin(), end.end() - 1);
  order.resize(matrix_of.size());
  for (std::size_t p = 0; p < matrix_of.size(); ++p) order[std::size_t(next[std::size_t(matrix_of[p])]++)] = Index(p);
  for (Index k = 0; k < matrices; ++k)
    for (Index first = end[std::size_t(k)]; first < end[std::size_t(k) + 1]; first += most) {
      const Index count = std::min(most, end[std::size_t(k) + 1] - first);
      const bool adjacent = order[std::size_t(first + count - 1)] - order[std::size_t(first)] == count - 1;
      tiles.push_back({k, first, count, adjacent});
    }
}

void multiply_places(const PlaceTiles& places, const MatrixList& X, Factor factor, const RowMatrix& in,
                     const RowMatrix* add, RowMatrix& out, RowShift shift, const HostThreads& threads) {
  struct Workspace {
    RowMatrix gathered, product;
  };
  const Index m = X.size();
  const bool transposed = factor == Factor::transposed;
  each_tile<Workspace>(places, threads, 16, [&](const PlaceTiles::Tile& tile, const Index* order, Workspace& work) {
    auto& [gathered, product] = work;
    const auto matrix = X[tile.matrix];
    gathered.resize(tile.count, m);
    if (tile.adjacent)
      gathered = in.middleRows(order[0] + shift.in, tile.count);
    else
      for (Index r = 0; r < tile.count; ++r) gathered.row(r) = in.row(order[r] + shift.in);
    product.resize(tile.count, m);
    if (tile.count == 1) {  // a matrix-vector product; Eigen's matrix product has more overhead
      if (transposed)
        product.row(0).transpose().noalias() = matrix * gathered.row(0).transpose();
      else
        product.row(0).transpose().noalias() = matrix.transpose() * gathered.row(0).transpose();
    } else if (transposed) {
      product.noalias() = gathered * matrix.transpose();
    } else {
      product.noalias() = gathered * matrix;
    }
    for (Index r = 0; r < tile.count; ++r) {
      const Index to = order[r] + shift.out;
      if (add) product.row(r) += add->row(to);
      if (factor == Factor::plus_identity) product.row(r) += gathered.row(r);
      out.row(to) = product.row(r);
    }
  });
}

HostStepChain::HostStepChain(const StepChainProblem& problem, const HostThreads& threads)
    : M_(problem.steps()),
      m_(problem.states()),
      map_of_(problem.map_of),
      memory_limit_(problem.memory_limit),
      threads_(threads) {
  for (const StepMap& map : problem.maps) plain_R_.push_back(map.plain_R());
}

RowMatrix HostStepChain::solve(RowMatrix d) {
  forward(d, d);
  return d;
}

RowMatrix HostStepChain::solve_transposed(RowMatrix q, const AdjointChoice& choice) {
  if (choice.method != AdjointMethod::jacobi) {
    adjoint(q, q, choice);
    return q;
  }
  RowMatrix l(q.rows(), q.cols());
  adjoint(q, l, choice);
  return l;
}

void HostStepChain::adjoint(const RowMatrix& q, RowMatrix& mu, const AdjointChoice& choice) {
  switch (choice.method) {
    case AdjointMethod::exact:  // a serial step is one matrix-vector product; host threads do not make up for the
                                // factor m of a scan
    case AdjointMethod::substitution:
      return substitute(q, mu);
    case AdjointMethod::jacobi:
      mu = q;
      // Row i depends on the rows i .. i+k-1: nothing changes after M+1 sweeps.
      for (Index k = 1; k < std::min(choice.checked_sweeps(), M_ + 1); ++k) {
        other_.resize(M_ + 1, m_);
        other_.row(M_) = q.row(M_);
        carry(q, mu, other_);
        mu.swap(other_);
      }
      break;
    case AdjointMethod::doubling:
      if (&mu != &q) mu = q;
      solve_by_doubling(increments("doubling"), map_of_, memory_limit_, mu, threads_);
      break;
    case AdjointMethod::scan:
      if (&mu != &q) mu = q;
      solve_by_scan(increments("scan"), map_of_, memory_limit_, mu, threads_);
      break;
  }
  finish(mu);
}

}  // namespace bromwich::host

namespace bromwich {

std::unique_ptr<StepChain> make_step_chain(const StepChainProblem& problem, const HostThreads& threads) {
  problem.validate();
  auto chain =
      problem.sparse() ? host::make_sparse_step_chain(problem, threads) : host::make_dense_step_chain(problem, threads);
  chain->on_host = true;
  return chain;
}

}  // namespace bromwich
