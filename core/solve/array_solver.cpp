#include "core/solve/array_solver.hpp"

#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/seam/shared_memory.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

// Below this size dense matrices are faster in everything (core/solve/reductions.cpp).
constexpr Index fewest_sparse_states = 512;

Scene without_sources(Scene scene) {
  if (scene.boundary) throw Error("scene", "has boundary values", "use solve, which takes them");
  if (!scene.free_rows.empty()) throw Error("scene", "has free rows", "use solve, which eliminates them");
  if (scene.constraints() == 0) throw Error("scene", "has no constraints", "use solve");
  scene.f = nullptr;
  scene.g = nullptr;
  scene.breakpoints.clear();
  scene.exact = {};
  scene.validate();
  if (scene.dynamics->has_mass()) {
    if (scene.dynamics->has_singular_mass()) throw Error("E", "is singular", "eliminate the algebraic equations");
    if (auto reduced = without_mass(scene)) scene = std::move(*reduced);
  }
  return scene.dynamics->matrices() && scene.states() <= fewest_sparse_states ? written_out(std::move(scene)) : scene;
}

SharedMemory& shared_memory_of(Backend& backend) {
  if (auto* shared = dynamic_cast<SharedMemory*>(&backend)) return *shared;
  throw Error("backend", "found '" + backend.name() + "', whose memory is its own", "use cpu or cuda");
}

}  // namespace

ArraySolver::ArraySolver(Scene scene, Backend& backend, Options options)
    : scene_(without_sources(std::move(scene))), backend_(backend), options_(std::move(options)) {
  shared_memory_of(backend_);
  const Index J = steps_of(scene_, options_), n = scene_.constraints();
  problem_ = std::make_unique<DiscreteProblem>(discretise(scene_, backend_, J, false));
  operator_ = make_time_operator(*problem_);
  operator_->keep_prepared();
  if (operator_->basis().rings)
    throw Error("scene", operator_->basis().reason + ": y may jump", "use solve with method march");
  if (const std::string why = operator_->missing_weights(); !why.empty()) throw Error("scene", why, "use solve");
  plan_ = operator_->kernel(options_.tuning.convolution);
  for (auto* array : {&g_, &known_, &start_, &r_, &v_, &y_, &w_}) *array = backend_.array(J + 1, n);
  lcp_ = backend_.lcp(scene_.M, problem_->lcp_class, J + 1);
  respond_to_x0();
}

ArraySolver::~ArraySolver() = default;

Array& ArraySolver::phi() {
  if (!phi_) phi_ = backend_.array(g_->rows(), g_->cols());
  return *phi_;
}

void ArraySolver::set_x0(const Vector& x0) {
  scene_.validate_x0(x0);
  scene_.x0 = x0;
  set_start(*problem_);
  operator_->renew({.x0 = true, .sources = false});
  respond_to_x0();
}

// known <- N e^{At} x0, and N x0 in every row of start.
void ArraySolver::respond_to_x0() {
  error_of_x0_ = operator_->response(plan_, *backend_.array(known_->rows(), known_->cols()), *known_);
  backend_.upload_product(RowMatrix::Ones(start_->rows(), 1), problem_->start, *start_);
}

Result ArraySolver::solve() {
  Timer timer;
  Result result;
  result.method = Method::contour;
  result.steps = steps();
  result.t = problem_->t;
  result.backend = backend_.name();
  result.kernel = plan_.description;
  result.kernel_error = std::isnan(plan_.error) ? NAN : std::max(plan_.error, error_of_x0_);
  SpaceTimeKernel& kernel = *plan_.kernel;
  for (Array* array : {v_.get(), y_.get()}) backend_.add(*known_, -1, *known_, *array);
  backend_.add(*known_, 1, *g_, *r_);
  if (phi_) {
    kernel.apply(*phi_, *v_, 0);
    backend_.add(*r_, 1, *v_, *r_);
    backend_.add(*known_, -1, *known_, *v_);
  }
  backend_.add(*start_, 1, *g_, *w_);
  const ApplyKernel apply = [&](const Array& in, Array& out, Index first) { kernel.apply(in, out, first); };
  const IterationOutcome outcome =
      iterate(*problem_, options_, apply, kernel.recorded(), *lcp_, *r_, *y_, *v_, result, w_.get());
  result.status = outcome.status;
  result.reason = outcome.reason;
  if (outcome.infeasible >= 0) result.infeasible_at = problem_->t[outcome.infeasible];
  kernel.apply(*y_, *v_, 0);
  result.residual = lcp_->residual(*r_, *v_, *y_);
  backend_.add(*r_, 1, *v_, *w_);
  shared_memory_of(backend_).add_product(scene_.M, *y_, *w_);
  backend_.wait();
  if (result.status == Status::solved && !std::isfinite(result.residual)) {
    result.status = Status::nonfinite;
    result.reason = "values of f or g are not finite";
  }
  result.seconds.total = result.seconds.solve = timer.lap();
  return result;
}

}  // namespace bromwich
