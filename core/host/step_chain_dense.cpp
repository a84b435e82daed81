// Chains of dense maps. Stored for every kind of step: the increment D and S^{-1}, so that a step is one matrix-vector
// product and operations on all rows are one matrix product per kind; R and R - S for residuals.

#include "core/base/denormals.hpp"
#include "core/host/step_chain_rows.hpp"

namespace bromwich::host {

namespace {

constexpr Index dense_tile_rows = 64;

class DenseStepChain final : public HostStepChain {
 public:
  DenseStepChain(const StepChainProblem& problem, const HostThreads& threads)
      : HostStepChain(problem, threads),
        places_(map_of_, Index(problem.maps.size()), dense_tile_rows),
        D_(Index(problem.maps.size()), m_),
        inverse_(Index(problem.maps.size()), m_),
        R_(Index(problem.maps.size()), m_),
        change_(Index(problem.maps.size()), m_) {
    share_each(threads, D_.count(), [&](Index k) {  // if several kinds fail, the threads decide which is reported
      const DenseStep step(problem, k);
      D_[k] = step.increment;
      inverse_[k] = step.inverse;
      R_[k] = step.R;
      change_[k] = step.change;
    });
  }

  std::size_t bytes() const override {
    return 4 * D_.bytes() + sizeof(Index) * 2 * map_of_.size() + sizeof(double) * std::size_t(other_.size());
  }

 private:
  void forward(const RowMatrix& d, RowMatrix& x) override {
    x.row(0) = d.row(0);
    multiply_places(places_, inverse_, Factor::transposed, d, nullptr, x, {1, 1}, threads_);
    const FlushDenormals guard;
    for (Index i = 1; i <= M_; ++i) {
      x.row(i).transpose().noalias() += D_[map_of_[std::size_t(i - 1)]] * x.row(i - 1).transpose();
      x.row(i) += x.row(i - 1);
    }
  }

  void substitute(const RowMatrix& q, RowMatrix& l) override {
    if (&l != &q) l = q;
    {
      const FlushDenormals guard;
      for (Index i = M_ - 1; i >= 0; --i) {
        l.row(i).transpose().noalias() += D_[map_of_[std::size_t(i)]].transpose() * l.row(i + 1).transpose();
        l.row(i) += l.row(i + 1);
      }
    }
    finish(l);
  }

  void carry(const RowMatrix& q, const RowMatrix& mu, RowMatrix& next) override {
    multiply_places(places_, D_, Factor::plus_identity, mu, &q, next, {1, 0}, threads_);
  }

  void finish(RowMatrix& mu) override {
    multiply_places(places_, inverse_, Factor::plain, mu, nullptr, mu, {1, 1}, threads_);
  }

  void apply(Index kind, RowFactor factor, const Rows& in, Rows out) override {
    switch (factor) {
      case RowFactor::inverse:
        out.noalias() = in * inverse_[kind];
        return;
      case RowFactor::R:
        out.noalias() = in * R_[kind];
        return;
      case RowFactor::R_transposed:
        out.noalias() = in * R_[kind].transpose();
        return;
      case RowFactor::change_transposed:
        out.noalias() = in * change_[kind].transpose();
    }
  }

  const MatrixList& increments(const char*) override { return D_; }

  PlaceTiles places_;
  MatrixList D_, inverse_, R_, change_;  ///< change: R - S
};

}  // namespace

std::unique_ptr<StepChain> make_dense_step_chain(const StepChainProblem& problem, const HostThreads& threads) {
  return std::make_unique<DenseStepChain>(problem, threads);
}

}  // namespace bromwich::host
