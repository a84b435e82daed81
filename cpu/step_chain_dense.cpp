// Chains of dense maps: P = S^{-1} R and S^{-1} of every kind of step, so that a step is one matrix-vector product and
// all that does not run along time is a matrix product for each kind.

#include "cpu/step_chain.hpp"

#include <optional>

namespace bromwich::cpu {

namespace {

constexpr Index dense_tile_rows = 64;

class DenseStepChain final : public CpuStepChain {
 public:
  DenseStepChain(const StepChainProblem& problem, int threads)
      : CpuStepChain(problem, threads),
        places_(map_of_, Index(problem.maps.size()), dense_tile_rows),
        P_(Index(problem.maps.size()), m_),
        inverse_(Index(problem.maps.size()), m_) {
    const Index kinds = P_.count();
    std::optional<Error> singular;  // which of several is told depends on the threads
#pragma omp parallel for num_threads(threads) schedule(static)
    for (Index k = 0; k < kinds; ++k) try {
        const DenseStep step(problem, k);
        P_[k] = step.P;
        inverse_[k] = step.inverse;
      } catch (const Error& error) {
#pragma omp critical(bromwich_singular_step)
        singular = error;
      }
    if (singular) throw *singular;
  }

  std::size_t bytes() const override {
    return P_.bytes() + inverse_.bytes() + sizeof(Index) * 2 * map_of_.size() +
           sizeof(double) * std::size_t(other_.size());
  }

 private:
  void forward(const RowMatrix& d, RowMatrix& x) override {
    x.row(0) = d.row(0);
    multiply_places(places_, inverse_, true, d, nullptr, x, {1, 1}, threads_);
    const FlushDenormals guard;
    for (Index i = 1; i <= M_; ++i)
      x.row(i).transpose().noalias() += P_[map_of_[std::size_t(i - 1)]] * x.row(i - 1).transpose();
  }

  void substitute(const RowMatrix& q, RowMatrix& l) override {
    l = q;
    {
      const FlushDenormals guard;
      for (Index i = M_ - 1; i >= 0; --i)
        l.row(i).transpose().noalias() += P_[map_of_[std::size_t(i)]].transpose() * l.row(i + 1).transpose();
    }
    finish(l);
  }

  void sweep(const RowMatrix& q, const RowMatrix& mu, RowMatrix& next) override {
    multiply_places(places_, P_, false, mu, &q, next, {1, 0}, threads_);
  }

  void finish(RowMatrix& mu) override { multiply_places(places_, inverse_, false, mu, nullptr, mu, {1, 1}, threads_); }

  const MatrixList& transitions(const char*) override { return P_; }

  PlaceTiles places_;
  MatrixList P_, inverse_;
};

}  // namespace

std::unique_ptr<StepChain> make_dense_step_chain(const StepChainProblem& problem, int threads) {
  return std::make_unique<DenseStepChain>(problem, threads);
}

}  // namespace bromwich::cpu
