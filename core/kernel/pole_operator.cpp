// Operator of dynamics known by shifted solves and represented by few poles (core/kernel/pole_fit.hpp). Where the fit
// misses its tolerance, the operator with lag weights takes over.

#include "core/kernel/operators.hpp"

#include "core/base/text.hpp"
#include "core/kernel/pole_fit.hpp"
#include "core/kernel/pole_plans.hpp"
#include "core/kernel/rough_response.hpp"
#include "core/kernel/states.hpp"
#include "core/numerics/phi.hpp"

#include <utility>

namespace bromwich {

namespace {

class PoleOperator : public TimeOperator {
 public:
  explicit PoleOperator(const DiscreteProblem& p) : TimeOperator(p), recorded_(std::in_place, p) {}

  std::string missing_weights() override { return model() ? "" : lags_->missing_weights(); }
  bool prefers_weights() const override { return true; }
  bool marches_by_euler() const override { return false; }
  std::size_t bytes_of_tables() const override {
    if (lags_) return lags_->bytes_of_tables();
    return (model_ ? model_->bytes() : 0) + sizeof(double) * std::size_t(free_.size());
  }

  std::shared_ptr<const PoleModel> poles() override { return model(); }

  KernelPlan kernel(ConvolutionChoice choice) override {
    return model() ? finest_kernel(weights(p_.J, nullptr, p_.J), choice) : lags_->kernel(choice);
  }

  KernelWeights kernel_weights(ConvolutionChoice choice) override {
    if (!model()) return lags_->kernel_weights(choice);
    return {weights(p_.J, nullptr, p_.J), description(), model_->error};
  }

  double response(const KernelPlan& plan, Array& work, Array& r) override {
    if (!model()) return lags_->response(plan, work, r);
    p_.backend.upload(p_.g.table() + free().leftCols(p_.scene.constraints()), r);
    return model_->error;
  }

  void renew(const Changes& changes) override {
    free_.resize(0, 0);
    if (lags_) return lags_->renew(changes);
    if (p_.scene.x0 == x0_ && (p_.f.size() > 0) == had_sources_) return;
    tried_ = false;
    model_.reset();
    forget_basis();
  }

  SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) override {
    if (!model()) return lags_->weights(steps, finer, finer_steps);
    return share_weights(PoleRecurrence{model_, p_.scene.T / double(steps)});
  }

  KernelPlan finest_kernel(const SharedWeights& weights, ConvolutionChoice choice) override {
    if (!model()) return lags_->finest_kernel(weights, choice);
    return {kernel_of(*weights, p_.J, choice), description(), model_->error};
  }

  MarchData march_weights(Rule rule, RecurrenceChoice choice) override {
    if (!model()) return lags_->march_weights(rule, choice);
    return {.weights = std::make_shared<Weights>(recurrence()), .error = model_->error, .description = description()};
  }

  void add_sources(Rule rule, MarchData& data, const Changes& changes) override {
    if (!model()) return lags_->add_sources(rule, data, changes);
    data.r = SampledSource(p_.g.table() + free().leftCols(p_.scene.constraints()));
    data.r_has_x0 = true;
    data.error = model_->error;
  }

  RowMatrix states(Rule rule, const RowMatrix& y, const std::vector<Index>& components,
                   const StepDefects* defects) override {
    if (lags_) return lags_->states(rule, y, components, defects);
    if (model_)
      if (auto x = recorded_->stepped(y)) return *std::move(x);
    if (!model_ || Index(components.size()) != model_->components)
      return RowMatrix::Constant(p_.J + 1, Index(components.size()), NAN);
    RowMatrix x = seen_components(p_.backend, recurrence(), y) + free().rightCols(model_->components);
    for (Index c = 0; c < x.cols(); ++c) x(0, c) = p_.scene.x0[components[std::size_t(c)]];
    return x;
  }

 protected:
  BasisChoice choose_basis() override {
    const RangeOfM range = range_of_M(p_);
    const BasisChoice choice = bromwich::choose_basis(p_.scene.M, p_.lcp_class, range);
    if (!choice.continuous) return choice;
    if (!model()) return lags_->basis();
    return bromwich::choose_basis(p_.scene.M, p_.lcp_class, implicit_part(recurrence()), at_minus_one(recurrence()),
                                  range);
  }

 private:
  PoleRecurrence recurrence() const { return {model_, p_.h}; }

  std::string description() const {
    return text("recurrences of %td poles, %td numbers in the state; %td shifted solves", model_->distinct,
                model_->driven, nodes_);
  }

  // Null: `lags_` has the weights.
  std::shared_ptr<const PoleModel> model() {
    if (tried_) return model_;
    tried_ = true;
    PoleFit fit = fit_pole_model(p_, recorded_->in_kernel());
    nodes_ = fit.nodes;
    model_ = std::move(fit.model);
    x0_ = p_.scene.x0;
    had_sources_ = p_.f.size() > 0;
    // Parts of rough steps of f = B phi need the weights of K themselves.
    if (model_ && p_.sources && had_sources_ && model_->sources == 0) model_.reset();
    if (!model_) {
      recorded_.reset();  // the other one makes them
      lags_ = make_lag_operator(p_);
    }
    return model_;
  }

  const RowMatrix& free() {
    if (free_.size() > 0) return free_;
    const Index n = p_.scene.constraints();
    const RowMatrix phi = had_sources_ ? p_.f.table() : RowMatrix();
    free_ = free_response(p_.backend, recurrence(), phi, p_.J + 1);
    if (p_.sources && had_sources_) free_ += rough_response(p_, table_of_sources());
    free_.row(0).head(n) = (p_.scene.dynamics->observe(p_.scene.x0)).transpose();
    return free_;
  }

  // Weights of phi, (n + c) x k.
  LagTable table_of_sources() const {
    const PoleModel& m = *model_;
    const Index outputs = m.n + m.components, k = m.sources, rows = p_.J + 1;
    LagTable table{outputs, k, false, RowMatrix::Zero(rows, outputs * k), RowMatrix::Zero(rows, outputs * k)};
    const ArrayPhi phi = array_phi(p_.h * m.poles.array());
    for (Index r = m.driven; r < m.driven + m.forced; ++r)
      for (Index i = 0; i < outputs; ++i) {
        const Index column = i * k + m.direction[std::size_t(r)];
        const double u = p_.h * m.output(i, r);
        table.W(0, column) += u * phi.phi2[r];
        double decay = 1;
        for (Index d = 1; d < rows; ++d, decay *= phi.exponential[r]) {
          table.W(d, column) += u * decay * phi.phi1[r] * phi.phi1[r];
          table.S(d, column) += u * decay * (phi.phi1[r] - phi.phi2[r]);
        }
      }
    for (Index i = 0; i < outputs; ++i) table.W.row(0).segment(i * k, k) += m.direct.row(i).tail(k);
    return table;
  }

  std::optional<RecordedStates> recorded_;
  bool tried_ = false, had_sources_ = false;
  Index nodes_ = 0;
  std::shared_ptr<const PoleModel> model_;
  std::unique_ptr<TimeOperator> lags_;  ///< in place of a model
  Vector x0_;                           ///< of model_
  RowMatrix free_;                      ///< (J+1) x (n + c): x0 and f
};

}  // namespace

bool poles_pay(const DiscreteProblem& p) {
  const double n = double(p.scene.constraints());
  return n * n * double(p.J + 1) >= fewest_tabulated;
}

std::unique_ptr<TimeOperator> make_pole_operator(const DiscreteProblem& p) { return std::make_unique<PoleOperator>(p); }

}  // namespace bromwich
