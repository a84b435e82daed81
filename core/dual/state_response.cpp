// K of the stages, and r with the state that x0 and f leave: on the backend in the modes of a Kronecker sum, otherwise
// by steps of the state on the host (core/host/stage_step.hpp).

#include "core/base/error.hpp"
#include "core/dual/dual_operator.hpp"
#include "core/dual/stage_weights.hpp"
#include "core/dynamics/line_transfer.hpp"
#include "core/host/stage_step.hpp"

#include <algorithm>
#include <cmath>
#include <future>
#include <numeric>
#include <utility>

namespace bromwich {

SparseMatrix entry_of_sources(const Scene& scene) {
  if (scene.f_entry == SourceEntry::through_F) return scene.F;
  if (scene.f_entry == SourceEntry::through_B) return scene.dynamics->inputs();
  SparseMatrix identity(scene.states(), scene.states());
  identity.setIdentity();
  return identity;
}

RowMatrix stage_values(const DiscreteProblem& p, const TimeFunction& function, const SampledSource& at_ends) {
  constexpr double first_node = 1.0 / 3;
  const RowMatrix& ends = at_ends.table();
  const Index width = ends.cols();
  RowMatrix values(p.J + 1, 2 * width);
  values.rightCols(width) = ends;
  Vector inner(p.J + 1);
  inner[0] = p.t[0];
  for (Index j = 1; j <= p.J; ++j) inner[j] = p.t[j - 1] + first_node * p.h;
  values.leftCols(width) = sample(function, inner, width).table();
  return values;
}

namespace {

constexpr Index fewest_fitted_line = 40;  ///< points of a line above which few poles are looked for

RowMatrix values_of(const DiscreteProblem& p, const TimeFunction& function, const SampledSource& at_ends,
                    Index stages) {
  return stages == 1 ? at_ends.table() : stage_values(p, function, at_ends);
}

Vector of_step(const RowMatrix& rows, Index j, Index stages) {
  if (stages == 1) return rows.row(j).transpose();
  Vector both(2 * rows.cols());
  both << rows.row(2 * j - 1).transpose(), rows.row(2 * j).transpose();
  return both;
}

std::shared_ptr<const ModalStages> all_modes(const DiscreteProblem& p) {
  const KroneckerDynamics& d = *p.modes();
  auto modal = std::make_shared<ModalStages>();
  modal->face = p.face();
  modal->along = d.face_eigenvalues();
  modal->rates = d.across.eigenvalues();
  modal->across = d.across.modes();
  modal->direct = d.n.dot(d.b);
  modal->input = d.of_modes(d.inputs_in_modes());
  modal->output = d.of_modes(d.across.in_modes(d.n));
  modal->start = x0_in_modes(p.backend, d, p.scene.x0, true).transpose();
  return modal;
}

// The steps of the state, with x0, f and g if `driven` and from zero otherwise.
struct StateSteps {
  StageProblem problem;
  std::unique_ptr<host::StageStep> step;
  Vector start;
  Index J, n, stages;

  StateSteps(const DiscreteProblem& p, Index stages_, bool driven) : J(p.J), n(p.scene.constraints()), stages(stages_) {
    problem.dynamics = &p.scene.dynamics;
    if (p.modes()) problem.modal = all_modes(p);
    problem.M = &p.scene.M;
    problem.lcp_class = p.lcp_class;
    problem.stages = stages;
    problem.h = p.h;
    problem.x0 = p.scene.x0;
    problem.g = driven ? values_of(p, p.scene.g, p.g, stages) : RowMatrix(RowMatrix::Zero(J + 1, stages * n));
    if (driven && p.f.size() > 0) {
      problem.phi = values_of(p, p.scene.f, p.f, stages);
      if (!p.modes()) problem.F = entry_of_sources(p.scene);
    }
    std::vector<Index> rows(std::size_t(J) + 1);
    std::iota(rows.begin(), rows.end(), Index(0));
    step = problem.modal ? host::make_modal_stage_step(problem, stages, p.h, rows)
                         : host::make_stage_step(problem, stages, p.h, rows);
    start = problem.modal ? Vector(Eigen::Map<const Vector>(problem.modal->start.data(), problem.modal->start.size()))
                          : p.scene.x0;
    if (!driven) start.setZero();
  }

  // N X + g of all stages with y (null: none); `see` is called with the state at the end of each step.
  template <class See>
  RowMatrix run(const RowMatrix* y, See see) {
    RowMatrix values = RowMatrix::Zero(stages * J + 1, n);
    Vector x = start, next(x.size()), q;
    for (Index j = 1; j <= J; ++j) {
      step->free(x, j, q, next);
      if (y) {
        const Vector given = of_step(*y, j, stages);
        q.noalias() += step->implicit_part() * given;
        step->drive(given, next);
      }
      if (stages == 2) values.row(2 * j - 1) = q.head(n).transpose();
      values.row(stages * j) = q.tail(n).transpose();
      x.swap(next);
      see(j, x);
    }
    return values;
  }
  RowMatrix run(const RowMatrix* y) {
    return run(y, [](Index, const Vector&) {});
  }
};

bool at_rest(const DiscreteProblem& p) { return p.scene.x0.isZero(0) && p.f.size() == 0; }

// A source at the stages, 2J + 1 rows.
SampledSource at_stages(const DiscreteProblem& p, const TimeFunction& function, Index width) {
  Vector t(2 * p.J + 1);
  t[0] = p.t[0];
  for (Index j = 1; j <= p.J; ++j) {
    t[2 * j - 1] = p.t[j - 1] + p.h / 3;
    t[2 * j] = p.t[j];
  }
  return sample(function, t, width);
}

// r <- g alone, with N x0 + g(0) in row 0.
void upload_g(const DiscreteProblem& p, Index stages, Array& r) {
  upload(p.backend, stages == 1 ? p.g : at_stages(p, p.scene.g, p.scene.constraints()), r);
  p.backend.upload(p.start.transpose(), r);
}

class SteppedResponse final : public DualResponse {
 public:
  SteppedResponse(const DiscreteProblem& p, Index stages) : p_(p), stages_(stages) {}

  void respond(const Changes&, Array& r) override {
    if (at_rest(p_)) return upload_g(p_, stages_, r);
    RowMatrix values = StateSteps(p_, stages_, true).run(nullptr);
    values.row(0) = p_.start.transpose();
    p_.backend.upload(values, r);
  }

  void apply(const Array& y, Array& v) override {
    if (!steps_) steps_ = std::make_unique<StateSteps>(p_, stages_, false);
    RowMatrix values;
    p_.backend.download(y, values);
    p_.backend.upload(steps_->run(&values), v);
  }

  std::size_t bytes() const override { return steps_ ? steps_->step->bytes() : 0; }

 private:
  const DiscreteProblem& p_;
  Index stages_;
  std::unique_ptr<StateSteps> steps_;
};

// Two stages of a Kronecker sum.
class ModalStageResponse final : public DualResponse {
 public:
  explicit ModalStageResponse(const DiscreteProblem& p) : p_(p) {}

  void respond(const Changes&, Array& r) override {
    if (!p_.scene.x0.isZero(0)) {
      RowMatrix values = StateSteps(p_, 2, true).run(nullptr);
      values.row(0) = p_.start.transpose();
      return p_.backend.upload(values, r);
    }
    upload_g(p_, 2, r);
    if (!p_.drive()) return;
    const auto input = p_.backend.array(r.rows(), r.cols()), v = p_.backend.array(r.rows(), r.cols());
    upload(p_.backend, at_stages(p_, p_.scene.f, p_.f.cols()), *input);
    apply(*input, *v);
    p_.backend.add(r, 1, *v, r);
  }

  void prepare() override {
    if (!recurrence_.valid())
      recurrence_ = std::async(p_.backend.threads() > 1 ? std::launch::async : std::launch::deferred,
                               [this] { return make_recurrence(); });
  }

  void apply(const Array& y, Array& v) override {
    if (!kernel_) {
      prepare();
      const Index rows = 2 * p_.J + 1;
      kernel_ = std::make_unique<SpaceTimeKernel>(p_.backend, p_.backend.stage_convolution(recurrence_.get(), rows),
                                                  p_.face(), rows, p_.scene.constraints());
    }
    kernel_->apply(y, v, 0);
  }

  std::size_t bytes() const override { return kernel_ ? kernel_->bytes() : 0; }

 private:
  // From the dynamics and the grid alone, which no renewal changes.
  StageRecurrence make_recurrence() const {
    const KroneckerDynamics& d = *p_.modes();
    const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
    const LineTransfer line(d.across, d.n, d.b);
    const auto exact = [&](Index l, Complex z) { return line(z - mu[l]); };
    PoleSum sum;
    sum.error = INFINITY;
    if (nu.size() > fewest_fitted_line)
      sum = fit_poles([&line](Complex z) -> ComplexVector { return ComplexVector::Constant(1, line(z)); }, 1,
                      {true, p_.h, p_.scene.T, -mu.maxCoeff(), -mu.minCoeff()}, -nu.maxCoeff(), -nu.minCoeff(), false);
    if (!(sum.error <= accepted_fit_error)) {
      sum.rates = nu;
      sum.coefficients = d.across.in_modes(d.n).cwiseProduct(d.across.in_modes(d.b));
      sum.constant = sum.linear = Vector::Zero(1);
    }
    return stage_recurrence(sum, mu, p_.h, exact);
  }

  const DiscreteProblem& p_;
  std::future<StageRecurrence> recurrence_;
  std::unique_ptr<SpaceTimeKernel> kernel_;
};

}  // namespace

std::unique_ptr<DualResponse> make_dual_response(TimeOperator& op, Index stages) {
  const DiscreteProblem& p = op.problem();
  if (p.modes() && stages == 2) return std::make_unique<ModalStageResponse>(p);
  if (p.modes() || p.small_state()) return std::make_unique<EulerResponse>(op);
  return std::make_unique<SteppedResponse>(p, stages);
}

RowMatrix stage_states(const DiscreteProblem& p, Index stages, const RowMatrix& y,
                       const std::vector<Index>& components) {
  RowMatrix x(p.J + 1, Index(components.size()));
  StateSteps steps(p, stages, true);
  Matrix along, across;
  if (p.modes()) {
    along = steps.problem.modal->face.matrix().transpose();
    across = steps.problem.modal->across;
  }
  const auto record = [&](Index j, const Vector& state) {
    if (!p.modes()) {
      for (std::size_t c = 0; c < components.size(); ++c) x(j, Index(c)) = state[components[c]];
      return;
    }
    const Index K = across.rows();
    const Eigen::Map<const RowMatrix> z(state.data(), K, along.rows());
    const Matrix values = across * z * along;  // positions x lines
    for (std::size_t c = 0; c < components.size(); ++c) x(j, Index(c)) = values(components[c] % K, components[c] / K);
  };
  for (std::size_t c = 0; c < components.size(); ++c) x(0, Index(c)) = p.scene.x0[components[c]];
  steps.run(&y, record);
  return x;
}

}  // namespace bromwich
