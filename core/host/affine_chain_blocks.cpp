// Chains of affine maps on the host (core/host/affine_chain.hpp). Blocks and intervals are distributed over the
// threads.

#include "core/host/affine_chain.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <mutex>

namespace bromwich::host {

namespace {

constexpr Index fewest_shared_values = 200'000;  ///< below it, waking threads costs more than it saves
constexpr Index intervals_together = 256;

// out += A v, without the overhead of a library call if A is small.
template <typename In, typename Out>
void add_product(const Matrix& A, const In& v, Out&& out) {
  constexpr Index small = 400;
  if (A.size() <= small)
    out.noalias() += A.lazyProduct(v);
  else
    out.noalias() += A * v;
}

class HostAffineChain final : public AffineChain {
 public:
  HostAffineChain(const AffineChainSizes& sizes, const HostThreads& threads)
      : N_(sizes.intervals),
        m_(sizes.states),
        n_(sizes.components),
        threads_(sizes.intervals * (sizes.states + sizes.components) >= fewest_shared_values ? threads : alone_),
        x_(N_ + 1, m_),
        v_(N_, n_),
        p_(N_, m_),
        P_(std::size_t(N_)) {}

  void set_sources(const RowMatrix& F, const RowMatrix& q) override {
    F_ = F;
    q_ = q;
  }

  void set_maps(const std::vector<const AffineMap*>& maps, const std::vector<int>& map_of) override {
    maps_ = maps;
    map_of_ = map_of;
    each_interval([&](Index k) {
      const AffineMap& map = map_at(k);
      P_[std::size_t(k)] = &map.P;
      auto input = p_.row(k).transpose();
      input.setZero();
      add_product(map.G, q_.row(k).transpose(), input);
      input = F_.row(k).transpose() - input;
    });
  }

  void condense(Index length, Blocks& blocks) override {
    const Index count = count_blocks(N_, length);
    const BlockProducts shared(map_of_, maps_.size(), length);
    blocks.products.assign(shared.block_of.size(), Matrix());
    blocks.Phi.resize(std::size_t(count));
    blocks.phi.resize(count, m_);
    share_each(threads_, count, [&](Index b) {
      const Index product = shared.product_of[std::size_t(b)];
      Matrix* const Phi = &blocks.products[std::size_t(product)];
      condense_steps(P_, p_, b * length, std::min(N_, (b + 1) * length),
                     shared.block_of[std::size_t(product)] == b ? Phi : nullptr, blocks.phi.row(b).transpose());
      blocks.Phi[std::size_t(b)] = Phi;
    });
  }

  BlockEnds expand(Index length, const RowMatrix& starts) override {
    const Index count = count_blocks(N_, length);
    BlockEnds ends(count, m_);
    share_each(threads_, count, [&](Index b) {
      x_.row(b * length) = starts.row(b);
      expand_steps(P_, p_, b * length, std::min(N_, (b + 1) * length), b, x_, ends);
    });
    x_.row(N_) = starts.row(count);
    return ends;
  }

  ActiveSizes evaluate() override {
    ActiveSizes all;
    all.finite = x_.row(N_).allFinite();
    std::mutex mutex;
    share(threads_, N_, intervals_together, [&](Index first, Index last) {
      const ActiveSizes sizes = evaluate(first, last);
      const std::lock_guard lock(mutex);
      all.active = std::max(all.active, sizes.active);
      all.inactive = std::max(all.inactive, sizes.inactive);
      all.finite = all.finite && sizes.finite;
    });
    return all;
  }

  void wrong_signs(double active_zero, double inactive_zero, SetWords& wrong) override {
    const Index words = words_of_set(n_);
    wrong.assign(std::size_t(N_ * words), 0);
    each_interval([&](Index k) {
      const AffineMap& map = map_at(k);
      for (Index i = 0; i < n_; ++i)
        if (v_(k, i) < -(contains(map.active.data(), i) ? active_zero : inactive_zero))
          wrong[std::size_t(k * words + i / 64)] |= std::uint64_t(1) << (i % 64);
    });
  }

  void download(RowMatrix& x, RowMatrix& v) override {
    x = x_;
    v = v_;
  }

  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(x_.size() + 2 * v_.size() + 2 * p_.size()) +
           P_.size() * (sizeof(void*) + sizeof(int));
  }

 private:
  void each_interval(const std::function<void(Index)>& use) const {
    share(threads_, N_, intervals_together, [&](Index first, Index last) {
      for (Index k = first; k < last; ++k) use(k);
    });
  }

  ActiveSizes evaluate(Index first, Index last) {
    ActiveSizes sizes;
    for (Index k = first; k < last; ++k) {
      const AffineMap& map = map_at(k);
      auto v = v_.row(k).transpose();
      v.setZero();
      add_product(map.X, x_.row(k).transpose(), v);
      add_product(map.Q, q_.row(k).transpose(), v);
      sizes.finite = sizes.finite && v.allFinite() && x_.row(k).allFinite();
      for (Index i = 0; i < n_; ++i) {
        double& largest = contains(map.active.data(), i) ? sizes.active : sizes.inactive;
        largest = std::max(largest, std::abs(v[i]));
      }
    }
    return sizes;
  }

  const AffineMap& map_at(Index k) const { return *maps_[std::size_t(map_of_[std::size_t(k)])]; }

  Index N_, m_, n_;
  HostThreads alone_;
  const HostThreads& threads_;
  RowMatrix x_, v_, p_, F_, q_;
  std::vector<const Matrix*> P_;
  std::vector<const AffineMap*> maps_;
  std::vector<int> map_of_;
};

}  // namespace

}  // namespace bromwich::host

namespace bromwich {

std::unique_ptr<AffineChain> make_affine_chain(const AffineChainSizes& sizes, const HostThreads& threads) {
  return std::make_unique<host::HostAffineChain>(sizes, threads);
}

}  // namespace bromwich
