// Operator of dynamics known by shifted solves: lag weights tabulated from contours (core/kernel/sparse_kernel.hpp).

#include "core/kernel/operators.hpp"

#include "core/kernel/sparse_kernel.hpp"
#include "core/kernel/states.hpp"

#include <utility>

namespace bromwich {

namespace {

class LagOperator : public TimeOperator {
 public:
  explicit LagOperator(const DiscreteProblem& p) : TimeOperator(p), recorded_(p) {}

  std::string missing_weights() override { return table() ? "" : "no contour holds the spectrum of this A"; }
  bool prefers_weights() const override { return true; }
  bool marches_by_euler() const override { return false; }
  std::size_t bytes_of_tables() const override { return table_ && *table_ ? (*table_)->bytes : 0; }

  KernelPlan kernel(ConvolutionChoice choice) override { return finest_kernel(lags(), choice); }

  double response(const KernelPlan&, Array&, Array& r) override {
    p_.backend.upload(p_.g.table() + table()->free, r);
    return table()->error;
  }

  // x0 and f have their own columns in the shifted solves.
  void renew(const Changes&) override {
    const RowMatrix& f = p_.f.values();
    const Matrix& shapes = p_.f.shapes();
    const bool same_f = !rough_f() && !rough_ && f.rows() == f_.rows() && f.cols() == f_.cols() && f == f_ &&
                        shapes.rows() == shapes_.rows() && shapes.cols() == shapes_.cols() && shapes == shapes_;
    const Vector& x0 = p_.scene.x0;
    if (same_f && x0.size() == x0_.size() && x0 == x0_) return;
    table_.reset();
    forget_basis();
  }

  SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) override {
    return finer ? share_weights(coarsened(*finer, finer_steps, steps, p_.backend)) : lags();
  }

  KernelPlan finest_kernel(const SharedWeights& weights, ConvolutionChoice choice) override {
    return {kernel_of(*weights, p_.J, choice), "FFT over lag weights; " + table()->description, table()->error};
  }

  MarchData march_weights(Rule, RecurrenceChoice) override {
    lags();
    return {.weights = lags_,
            .error = table()->error,
            .description = "lag weights, summed in blocks of time; " + table()->description};
  }
  void add_sources(Rule, MarchData& data, const Changes&) override {
    data.r = SampledSource(p_.g.table() + table()->free);
    data.r_has_x0 = true;
    data.error = table()->error;
  }

  RowMatrix states(Rule, const RowMatrix& y, const std::vector<Index>& components, const StepDefects*) override {
    if (!table_ || !*table_) return RowMatrix::Constant(p_.J + 1, Index(components.size()), NAN);
    if (auto x = recorded_.stepped(y)) return *std::move(x);
    return sparse_states(p_, **table_, y);
  }

 protected:
  KernelWeights kernel_weights(ConvolutionChoice) override {
    const SharedWeights weights = lags();
    return {weights, "FFT over lag weights; " + table()->description, table()->error};
  }

  BasisChoice choose_basis() override {
    const RangeOfM range = range_of_M(p_);
    BasisChoice choice = bromwich::choose_basis(p_.scene.M, p_.lcp_class, range);
    return choice.continuous && table()
               ? bromwich::choose_basis(p_.scene.M, p_.lcp_class, *lag_table_of(*lags()), range)
               : choice;
  }

 private:
  // Whether f is rough on some steps.
  bool rough_f() const { return p_.sources && p_.f.size() > 0; }
  const SparseKernel* table() {
    if (table_) return *table_ ? &**table_ : nullptr;
    table_ = sparse_kernel(p_, recorded_.in_kernel());
    x0_ = p_.scene.x0;
    f_ = p_.f.values();
    shapes_ = p_.f.shapes();
    rough_ = rough_f();
    if (!*table_) return nullptr;
    LagTable weights = std::exchange((*table_)->weights, {});
    if (!lags_) lags_ = std::make_shared<Weights>(std::move(weights));  // weights do not depend on sources
    return &**table_;
  }
  SharedWeights lags() {
    table();
    return lags_;
  }

  RecordedStates recorded_;
  std::optional<std::optional<SparseKernel>> table_;  ///< its weights are in lags_
  std::shared_ptr<Weights> lags_;
  Vector x0_;    ///< x0 of table_
  RowMatrix f_;  ///< phi of table_
  Matrix shapes_;
  bool rough_ = false;  ///< table_ includes the response to rough steps
};

}  // namespace

std::unique_ptr<TimeOperator> make_lag_operator(const DiscreteProblem& p) { return std::make_unique<LagOperator>(p); }

}  // namespace bromwich
