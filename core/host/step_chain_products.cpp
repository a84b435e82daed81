// The exact parallel adjoints. Products of maps P_{i+L} ... P_{i+1} = I + D carry mu_{i+L} to mu_i.

#include "core/host/step_chain_rows.hpp"

#include <algorithm>

namespace bromwich::host {

namespace {

constexpr Index doubling_tile_rows = 64;
/// Steps per product of a scan. Products grow away from I, and so does their rounding error.
constexpr Index scan_steps = 128;

}  // namespace

void solve_by_doubling(const MatrixList& D, const std::vector<Index>& map_of, double memory_limit, RowMatrix& mu,
                       const HostThreads& threads) {
  const Index m = D.size(), M = Index(map_of.size());
  RowMatrix next(mu.rows(), m);
  MatrixList products;                // of the windows of `length` steps, by name
  std::vector<Index> names = map_of;  // of the window of steps that follows row i
  Index kinds = D.count();
  for (Index length = 1;; length *= 2) {
    const MatrixList& X = length == 1 ? D : products;
    next.bottomRows(length) = mu.bottomRows(length);
    multiply_places({names, kinds, doubling_tile_rows}, X, Factor::plus_identity, mu, &mu, next, {length, 0}, threads);
    mu.swap(next);
    if (2 * length > M) return;

    WindowNames windows = join_windows(names, kinds, length);
    kinds = Index(windows.halves.size());
    check_products(8.0 * double(m * m) * double(kinds + X.count()), memory_limit, "doubling");
    MatrixList longer(kinds, m);
    share_each(threads, kinds, [&](Index k) {
      const auto [early, late] = windows.halves[std::size_t(k)];
      longer[k].noalias() = X[late] * X[early];
      longer[k] += X[late] + X[early];
    });
    products = std::move(longer);
    names = std::move(windows.of);
  }
}

void solve_by_scan(const MatrixList& D, const std::vector<Index>& map_of, double memory_limit, RowMatrix& mu,
                   const HostThreads& threads) {
  const Index m = D.size(), M = Index(map_of.size());
  const double block_bytes = 16.0 * double((m + 1) * m);
  const Index fewest = std::min<Index>(M, 4 * threads.threads());
  const Index most = std::max(fewest, Index(std::min(memory_limit / block_bytes, double(M))));
  const Index blocks = std::clamp((M + scan_steps - 1) / scan_steps, fewest, most), length = (M + blocks - 1) / blocks;
  check_products(block_bytes * double(blocks), memory_limit, "scan");
  const auto step = [&](Index i) { return D[map_of[std::size_t(i)]]; };
  // carry_b: m rows of P_last ... P_{first+1} - I, and one row with the contribution of the block's own q.
  std::vector<RowMatrix> carry(static_cast<std::size_t>(blocks));
  share_each(threads, blocks, [&](Index b) {
    const Index first = std::min(M, b * length), last = std::min(M, first + length);
    RowMatrix& now = carry[std::size_t(b)];
    RowMatrix before;
    now.setZero(m + 1, m);
    for (Index i = last - 1; i >= first; --i) {
      before = now;
      now.noalias() += before * step(i);
      now.topRows(m) += step(i);
      now.row(m) += mu.row(i);
    }
  });
  // mu at the first row of each block, from the last block to the first.
  RowMatrix entry(blocks + 1, m);
  entry.row(blocks) = mu.row(M);
  for (Index b = blocks - 1; b >= 0; --b) {
    const RowMatrix& block = carry[std::size_t(b)];
    entry.row(b) = block.row(m) + entry.row(b + 1) * block.topRows(m);
    entry.row(b) += entry.row(b + 1);
  }
  share_each(threads, blocks, [&](Index b) {
    const Index first = std::min(M, b * length), last = std::min(M, first + length);
    Vector next = entry.row(b + 1).transpose();
    for (Index i = last - 1; i >= first; --i) {
      mu.row(i).transpose().noalias() += step(i).transpose() * next;
      mu.row(i) += next.transpose();
      next = mu.row(i).transpose();
    }
  });
}

}  // namespace bromwich::host
