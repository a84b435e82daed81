// Operator of Kronecker sums: works in modes, one scalar convolution per mode.

#include "core/kernel/operators.hpp"

#include "core/base/text.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/modal_states.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/kernel/transfer_fit.hpp"

#include <cmath>

namespace bromwich {

namespace {

/// A fit takes 20 or more exponentials; up to this many eigenvalues it would not halve their number.
constexpr Index fewest_compressed = 40;

// V^T N (discrete e^{A t_j}) x0 by stepping all modes; used if the recurrence cannot represent x0.
RowMatrix stepped_initial_response(const DiscreteProblem& p, Rule rule) {
  const KroneckerDynamics& d = *p.modes();
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues(), seen = d.across.in_modes(d.n);
  RowMatrix x = x0_in_modes(p.backend, d, p.scene.x0, true), decay(x.rows(), x.cols()), modes(p.J + 1, x.rows());
  for (Index l = 0; l < mu.size(); ++l)
    for (Index k = 0; k < nu.size(); ++k) {
      const double z = p.h * (mu[l] + nu[k]);
      decay(l, k) = rule == Rule::exponential ? std::exp(z) : 1 / (1 - z);
    }
  for (Index j = 0; j <= p.J; ++j, x.array() *= decay.array()) modes.row(j) = (x * seen).transpose();
  return modes;
}

// g + V modes, on the host.
RowMatrix with_modes(const DiscreteProblem& p, const RowMatrix& values) {
  const auto modes = p.backend.array(values.rows(), values.cols()), r = p.backend.array(values.rows(), values.cols());
  p.backend.upload(values, *modes);
  upload(p.backend, p.g, *r);
  p.backend.face_transform(p.face(), values.rows(), Way::to_points)->apply(*modes, r.get(), *r, 0);
  RowMatrix sum;
  p.backend.download(*r, sum);
  return sum;
}

class ModalOperator : public TimeOperator {
 public:
  explicit ModalOperator(const DiscreteProblem& p) : TimeOperator(p), dynamics_(*p.modes()) {}

  void renew(const Changes& changes) override {
    if (changes.x0) x0_.reset();
  }

  KernelPlan kernel(ConvolutionChoice choice) override {
    KernelWeights made = kernel_weights(choice);
    if (recurrence_of(*made.weights)) {
      KernelPlan scan = plan(made.weights, choice);
      scan.description = std::move(made.description);
      return scan;
    }
    const Index rows = p_.J + 1, n = dynamics_.face_points();
    auto convolution = p_.backend.convolution(*lag_table_of(*made.weights), rows);
    return {std::make_unique<SpaceTimeKernel>(p_.backend, std::move(convolution), p_.face(), rows, n),
            std::move(made.description), made.error};
  }

  double response(const KernelPlan& plan, Array& v, Array& r) override {
    const auto input = p_.backend.array(p_.J + 1, p_.scene.constraints());
    upload(p_.backend, p_.g, r);
    p_.backend.upload(p_.start.transpose(), r);  // row 0: the kernel has no value at t = 0
    const double error = add_x0(plan, *input, r, r);
    add_driven(plan, *input, v, r);
    return error;
  }

  bool separates_x0() const override { return true; }

  void response_to_sources(const KernelPlan& plan, Array& input, Array& v, Array& r) override {
    upload(p_.backend, p_.g, r);
    add_driven(plan, input, v, r);
  }

  double add_x0(const KernelPlan& plan, Array& zero, const Array& known, Array& r) override {
    const ModalRecurrence* weights = plan.weights ? modal_recurrence_of(*plan.weights) : nullptr;
    if (const ProjectedX0* x0 = weights ? projected() : nullptr;
        x0 && plan.kernel->add_start(*weights, *x0->D, zero, known, r, keeps_prepared()))
      return x0->error;
    RowMatrix modes = kronecker_initial_response(p_);
    modes.row(0).setZero();
    p_.backend.upload(modes, zero);
    p_.backend.face_transform(p_.face(), r.rows(), Way::to_points)->apply(zero, &known, r, 0);  // g + N e^{At} x0
    return 0;
  }

  // If no short sum fits, all eigenvalues are used. The fit of the finest grid serves all grids.
  SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) override {
    if (finer) return share_weights(coarsened(*finer, finer_steps, steps, p_.backend));
    const double h = p_.scene.T / double(steps);
    return share_weights(Recurrence(fits() ? compressed_recurrence(p_.backend, dynamics_, sum(), h)
                                           : modal_recurrence(dynamics_, Rule::exponential, h, RowMatrix())));
  }

  KernelPlan finest_kernel(const SharedWeights& weights, ConvolutionChoice choice) override {
    KernelPlan made = plan(weights, choice);
    made.description = (by_fft(choice) ? "FFT over lag weights of " : "scan of ") +
                       (fits() ? std::to_string(sum().rates.size()) + " exponentials a mode, fitted to contour values"
                               : "all " + std::to_string(dynamics_.across.points) + " eigenvalues a mode");
    return made;
  }

  const SampledSource* drive() const override { return p_.drive(); }

  MarchData march_weights(Rule rule, RecurrenceChoice choice) override {
    const Index all = dynamics_.across.points;
    const bool chosen = choice == RecurrenceChoice::compressed;
    const bool compressed = rule == Rule::exponential && choice != RecurrenceChoice::modal &&
                            (choice == RecurrenceChoice::compressed || all > fewest_compressed) && fits() &&
                            (choice == RecurrenceChoice::compressed || 2 * sum().rates.size() <= all);
    if (compressed)
      return {
          .weights = std::make_shared<Weights>(Recurrence(compressed_recurrence(p_.backend, dynamics_, sum(), p_.h))),
          .error = error_of_fit(),
          .description = std::to_string(sum().rates.size()) + " exponentials a mode, stepped",
          .compressed = true};
    if (rule == Rule::implicit_euler && choice != RecurrenceChoice::modal && (all > fewest_compressed || chosen))
      if (auto data = compressed_euler(chosen)) return std::move(*data);
    return {.weights = std::make_shared<Weights>(Recurrence(modal_recurrence(dynamics_, rule, p_.h, RowMatrix()))),
            .description = std::to_string(all) + " eigenvalues a mode, stepped"};
  }

  // x0 goes into the recurrence if it can represent it, otherwise into a table of its response.
  void add_sources(Rule rule, MarchData& data, const Changes& changes) override {
    auto& recurrence = std::get<ModalRecurrence>(std::get<Recurrence>(*data.weights));
    data.drive = p_.drive();
    if (changes.sources || data.r_has_x0) data.r = p_.g;
    data.r_has_x0 = false;
    if (!changes.x0 && recurrence.initial.size() > 0) return;
    data.error_of_x0 = 0;
    if (data.compressed && rule == Rule::implicit_euler) {
      if (p_.scene.x0.isZero(0)) return;
      data.r = SampledSource(with_modes(p_, stepped_initial_response(p_, rule)));
      data.r_has_x0 = true;
      return;
    }
    if (data.compressed) {
      if (auto start = start_in(recurrence)) {
        recurrence.initial = std::move(*start);
        data.error_of_x0 = x0_->error;
      } else {
        recurrence.initial.resize(0, 0);
        data.r = SampledSource(with_modes(p_, kronecker_initial_response(p_)));
        data.r_has_x0 = true;
      }
      return;
    }
    const Matrix b = dynamics_.inputs_in_modes();
    if (b.cwiseAbs().minCoeff() > 1e-10 * b.cwiseAbs().maxCoeff()) {
      recurrence.initial =
          modal_start(recurrence, dynamics_, rule, p_.h, x0_in_modes(p_.backend, dynamics_, p_.scene.x0, true));
    } else {
      data.r = SampledSource(with_modes(p_, stepped_initial_response(p_, rule)));
      data.r_has_x0 = true;
    }
  }

  RowMatrix states(Rule rule, const RowMatrix& y, const std::vector<Index>& components, const StepDefects*) override {
    if (components.empty()) return RowMatrix(p_.J + 1, 0);
    return modal_states(p_, rule, y, components);
  }

 protected:
  KernelWeights kernel_weights(ConvolutionChoice choice) override {
    const auto parameters = contour_parameters(0);
    const bool scans = choice == ConvolutionChoice::scan || p_.backend.ranks() > 1;  // a state goes from slab to slab
    if (choice != ConvolutionChoice::fft && (fits() || scans))
      return {weights(p_.J, nullptr, 0),
              fits() ? text("scan of %ld exponentials a mode, fitted to contour values (%ld nodes a window)",
                            long(sum().rates.size()), long(parameters->P + 1))
                     : text("scan of all %ld eigenvalues a mode", long(dynamics_.across.points)),
              fits() ? error_of_fit() : NAN};
    // The table holds the contour values themselves, so there is no second result to compare: the error is not known.
    return {share_weights(contour_lag_table(p_.backend, dynamics_, *parameters, p_.h, p_.J)),
            text("FFT over lag weights from contours of %ld nodes a window", long(parameters->P + 1)), NAN};
  }

  BasisChoice choose_basis() override { return bromwich::choose_basis(p_.scene.M, p_.lcp_class); }
  bool modal() const override { return true; }

 private:
  // r <- r + response to f.
  void add_driven(const KernelPlan& plan, Array& input, Array& v, Array& r) {
    add_rough_response(p_, r);
    if (!p_.drive()) return;
    upload(p_.backend, *p_.drive(), input);
    plan.kernel->apply(input, v, 0);
    p_.backend.add(r, 1, v, r);
  }

  // Implicit Euler with few poles instead of all eigenvalues, where they halve their number at least. They do not
  // represent x0, whose response would have to be stepped.
  std::optional<MarchData> compressed_euler(bool chosen) {
    if (!chosen && !p_.scene.x0.isZero(0)) return std::nullopt;
    std::vector<LineTransfer> line;
    for (Index f = 0; f < dynamics_.families(); ++f)
      line.emplace_back(dynamics_.across, dynamics_.n, dynamics_.input(f));
    const PoleSum fit = fit_line(dynamics_, false, p_.h, p_.scene.T);
    const Vector mu = dynamics_.face_eigenvalues();
    const Index n = mu.size(), K = fit.rates.size();
    if (!(fit.error <= accepted_compression_error) || (!chosen && 2 * K > dynamics_.across.points)) return std::nullopt;
    ModalRecurrence r;
    r.face = p_.face();
    r.families = dynamics_.families();
    r.decay.resize(K, n);
    r.output.resize(K, n);
    r.start = RowMatrix::Zero(K, n);
    r.w0.resize(n);
    r.w1 = r.s1 = Vector::Zero(n);
    for (Index l = 0; l < n; ++l) {
      const Index family = dynamics_.family(l);
      r.w0[l] = line[std::size_t(family)](1 / p_.h - mu[l]).real();
      for (Index k = 0; k < K; ++k) {
        const double E = 1 / (1 - p_.h * (fit.rates[k] + mu[l]));
        r.decay(k, l) = E;
        r.output(k, l) = fit.coefficients(k, family) * p_.h * E * E;
      }
    }
    return MarchData{.weights = std::make_shared<Weights>(Recurrence(std::move(r))),
                     .error = fit.error,
                     .description = std::to_string(K) + " exponentials a mode, stepped",
                     .compressed = true};
  }

  KernelFit& fit() {
    if (!fit_) fit_ = p_.shared->fit(p_.h, p_.scene.T);
    return *fit_;
  }
  const ExponentialSum& sum() { return fit().sum; }
  double error_of_fit() { return fit().error_from(p_.h); }
  bool fits() { return error_of_fit() <= accepted_compression_error; }

  // x0 by the exponentials of the fit.
  struct ProjectedX0 {
    double error;
    const Array* D;  ///< null: the error is too large. Shared by all grids of the scene, whose x0 is the same.
  };
  const ProjectedX0* projected() {
    if (!x0_) {
      const InitialFit& of_x0 = p_.shared->initial_fit(p_.backend, fit());
      const double error = initial_error(p_.backend, dynamics_, of_x0, p_.scene.x0);
      x0_ = {error, error <= accepted_compression_error ? &(*of_x0.project)(p_.scene.x0) : nullptr};
    }
    return x0_->D ? &*x0_ : nullptr;
  }
  std::optional<RowMatrix> start_in(const ModalRecurrence& recurrence) {
    if (!projected()) return std::nullopt;
    RowMatrix D;
    p_.backend.download(*x0_->D, D);
    return start_of(recurrence, D, p_.backend);
  }

  KernelPlan plan(const SharedWeights& weights, ConvolutionChoice choice) {
    KernelPlan made{kernel_of(*weights, p_.J, choice), "", NAN};
    if (!fits()) return made;
    made.error = error_of_fit();
    if (!by_fft(choice)) made.weights = weights;
    return made;
  }

  const KroneckerDynamics& dynamics_;
  std::shared_ptr<KernelFit> fit_;
  std::optional<ProjectedX0> x0_;
};

}  // namespace

std::unique_ptr<TimeOperator> make_modal_operator(const DiscreteProblem& p) {
  return std::make_unique<ModalOperator>(p);
}

}  // namespace bromwich
