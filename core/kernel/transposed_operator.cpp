#include "core/kernel/transposed_operator.hpp"

#include "core/base/error.hpp"

#include <map>
#include <utility>

namespace bromwich {

namespace {

class TransposedOperator final : public TimeOperator {
 public:
  TransposedOperator(const DiscreteProblem& p, TimeOperator& of) : TimeOperator(p), of_(of) {}

  KernelPlan kernel(ConvolutionChoice choice) override {
    KernelWeights made = kernel_weights(choice);
    return {kernel_of(*made.weights, p_.J, choice), std::move(made.description), made.error};
  }
  KernelWeights kernel_weights(ConvolutionChoice choice) override {
    KernelWeights made = of_.kernel_weights(choice);
    made.weights = share_weights(transposed(*made.weights));
    made.description += ", transposed";
    return made;
  }

  double response(const KernelPlan&, Array&, Array& r) override {
    upload(p_.backend, p_.g, r);
    return 0;
  }

  // The weights of coarser grids come from those of finer ones that are not transposed.
  SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) override {
    const auto from = finer ? given_.find(finer_steps) : given_.end();
    const SharedWeights own =
        of_.weights(steps, from != given_.end() ? from->second.get() : nullptr, from != given_.end() ? finer_steps : 0);
    given_[steps] = own;
    return share_weights(transposed(*own));
  }
  KernelPlan finest_kernel(const SharedWeights& weights, ConvolutionChoice choice) override {
    return {kernel_of(*weights, p_.J, choice), "adjoint", NAN};
  }

  MarchData march_weights(Rule rule, RecurrenceChoice choice) override {
    MarchData data = of_.march_weights(rule, choice);
    data.weights = std::make_shared<Weights>(transposed(*data.weights));
    data.description += ", backwards in time";
    return data;
  }
  void add_sources(Rule, MarchData& data, const Changes&) override { data.r = p_.g; }

  RowMatrix states(Rule, const RowMatrix&, const std::vector<Index>&, const StepDefects*) override {
    throw Error("states", "an adjoint problem has none", "use K^T");
  }

 protected:
  BasisChoice choose_basis() override { return bromwich::choose_basis(p_.scene.M, p_.lcp_class); }
  bool modal() const override { return p_.modes() != nullptr; }

 private:
  TimeOperator& of_;
  std::map<Index, SharedWeights> given_;
};

}  // namespace

std::unique_ptr<TimeOperator> make_transposed_operator(const DiscreteProblem& p, TimeOperator& of) {
  return std::make_unique<TransposedOperator>(p, of);
}

}  // namespace bromwich
