// Operator of dense dynamics: steps the state.

#include "core/kernel/operators.hpp"

#include "core/base/text.hpp"
#include "core/kernel/closed_loop.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/kernel/weight_check.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double accepted_kernel_error = 1e-11;  ///< larger errors of a contour kernel in its check are rejected

// Largest deviation of two tables, relative to the largest weight.
double deviation(const LagTable& a, const LagTable& b) {
  const double scale = std::max(a.W.cwiseAbs().maxCoeff(), 1e-300);
  return std::max((a.W - b.W).cwiseAbs().maxCoeff(), (a.S - b.S).cwiseAbs().maxCoeff()) / scale;
}

class DenseOperator : public TimeOperator {
 public:
  explicit DenseOperator(const DiscreteProblem& p) : TimeOperator(p), dynamics_(*p.small_state()) {}

  bool takes_parts() const override { return p_.sources != nullptr; }

  KernelPlan kernel(ConvolutionChoice choice) override {
    const Index rows = p_.J + 1, n = p_.scene.constraints();
    KernelWeights made = kernel_weights(choice);
    const LagTable* table = lag_table_of(*made.weights);
    auto convolution =
        table ? p_.backend.convolution(*table, rows) : p_.backend.convolution(*recurrence_of(*made.weights), rows);
    return {std::make_unique<SpaceTimeKernel>(p_.backend, std::move(convolution), std::vector<Index>{}, rows, n),
            std::move(made.description), made.error};
  }

  double response(const KernelPlan&, Array&, Array& r) override {
    p_.backend.upload(dense_response(p_, Rule::exponential), r);
    return 0;
  }

  SharedWeights weights(Index steps, const Weights*, Index) override {
    if (steps == p_.J)
      return share_weights(Recurrence(dense_recurrence(dynamics_, *state_step(p_, Rule::exponential))));
    const double h = p_.scene.T / double(steps);
    return share_weights(Recurrence(dense_recurrence(dynamics_, *p_.shared->step(Rule::exponential, h, steps))));
  }

  KernelPlan finest_kernel(const SharedWeights&, ConvolutionChoice choice) override { return kernel(choice); }

  std::optional<RowMatrix> coarse_response(Index steps) override {
    if (p_.f.size() == 0) return std::nullopt;
    return dense_response(coarser(p_, steps), Rule::exponential);
  }

  MarchData march_weights(Rule rule, RecurrenceChoice) override {
    const DenseRecurrence recurrence = dense_recurrence(dynamics_, *state_step(p_, rule));
    MarchData data{.weights = std::make_shared<Weights>(Recurrence(recurrence)),
                   .description = "state of the scene, stepped"};
    if (rule == Rule::implicit_euler) return data;
    const double m = double(p_.scene.states()), n = double(p_.scene.constraints());
    const WeightCheck check = check_weights(p_, recurrence, double(p_.J) * (m * m + 2 * m * n));
    data.error = check.error;
    data.description +=
        " by the matrix exponential" + (check.against.empty() ? "" : ", checked against " + check.against);
    return data;
  }

  // The state carries x0 and f, so no growing parts are computed separately and cancelled later.
  void add_sources(Rule rule, MarchData& data, const Changes& changes) override {
    const std::shared_ptr<const StepOperators> operators = state_step(p_, rule);
    const StepOperators& step = *operators;
    if (changes.sources) data.r = p_.g;
    data.start = step.decay * p_.scene.x0;
    if (p_.f.size() == 0) return;
    const Matrix F = source_matrix(p_), left = step.left * F;
    data.start += left * p_.f.row(0);
    if (!changes.sources) return;
    const Matrix right = step.right * F;
    data.source_input = step.decay * right + left;
    data.forcing = p_.f.table() * data.source_input.transpose();
    data.r = SampledSource(p_.g.table() + p_.f.table() * (dynamics_.N * right).transpose());
  }

  RowMatrix states(Rule rule, const RowMatrix& y, const std::vector<Index>& components,
                   const StepDefects* defects) override {
    if (components.empty()) return RowMatrix(p_.J + 1, 0);
    return states_of(p_, rule, y, defects).x(Eigen::all, components);
  }

 protected:
  KernelWeights kernel_weights(ConvolutionChoice choice) override {
    const Recurrence recurrence = dense_recurrence(dynamics_, *state_step(p_, Rule::exponential));
    const Spectrum spectrum = p_.shared->spectrum();
    const auto parameters = contour_parameters(spectrum.half_angle);
    KernelWeights made;
    const bool scan = choice == ConvolutionChoice::scan || !by_fft(choice);
    // Two independent ways to the weights check each other; a scan needs only the first lags for that.
    const Index checked = scan ? std::min<Index>(p_.J, 64) : p_.J;
    LagTable table = lag_table(recurrence, checked);
    std::string source = "matrix exponential (" + spectrum.describe() + ")";
    made.error = NAN;
    if (!parameters || needs_precision(dynamics_.A, p_.h, p_.J)) {
      const WeightCheck check = check_weights(p_, std::get<DenseRecurrence>(recurrence), INFINITY);
      made.error = check.error;
      if (!check.against.empty()) source += ", checked against " + check.against;
    } else {
      LagTable contour = contour_lag_table(p_.backend, dynamics_, *parameters, p_.h, checked);
      made.error = deviation(table, contour);
      if (made.error <= accepted_kernel_error) {
        source = scan ? text("matrix exponential, checked against contours of %ld nodes", long(parameters->P + 1))
                      : text("contours of %ld nodes a window, checked against the matrix exponential",
                             long(parameters->P + 1));
        table = std::move(contour);
      } else {
        // Non-normal A defeats the contour, and stiff A costs both ways some digits: use the exponential, report the
        // difference.
        source = text("matrix exponential, from which contours differ by %.1e", made.error);
      }
    }
    made.weights = scan ? share_weights(recurrence) : share_weights(std::move(table));
    made.description = (scan ? "scan of the state; " : "FFT over lag weights; ") + source;
    return made;
  }

  BasisChoice choose_basis() override {
    return bromwich::choose_basis(p_.scene.M, p_.lcp_class,
                                  dense_recurrence(dynamics_, *state_step(p_, Rule::exponential)), range_of_M(p_));
  }

  // Compares multiplications of one application: the recurrence against transforms of length 2J.
  bool by_fft(ConvolutionChoice choice) const override {
    if (choice != ConvolutionChoice::automatic) return choice == ConvolutionChoice::fft;
    if (p_.backend.ranks() > 1) return false;  // a state goes from slab to slab
    return !scan_is_cheaper(double(p_.scene.states()), double(p_.scene.constraints()), double(p_.J));
  }

 private:
  const DenseDynamics& dynamics_;
};

}  // namespace

std::unique_ptr<TimeOperator> make_dense_operator(const DiscreteProblem& p) {
  return std::make_unique<DenseOperator>(p);
}

}  // namespace bromwich
