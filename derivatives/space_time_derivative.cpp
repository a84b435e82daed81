#include "derivatives/space_time_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/transposed_operator.hpp"
#include "core/kernel/transposed_start.hpp"
#include "core/result/located.hpp"
#include "derivatives/check_table.hpp"
#include "derivatives/lcp_terms.hpp"
#include "derivatives/make_state_maps.hpp"

#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double left_where_y_acts = 1e-7;  ///< of the largest terms of w: what w may leave where y acts
constexpr double smallest_rcond_at_zero = 1e-14;
constexpr double most_tabulated = 1 << 28;  ///< (J+1) n^2 of lag weights: 2 GiB
constexpr double largest_growth = 9;  ///< of log |x|: responses to x0 and y that grow by more cancel too many digits

[[noreturn]] void refuse_here(const std::string& found, const std::string& remedy) {
  throw Error("derivative", found, remedy);
}

const Scene& checked_for_all_times(const Scene& scene, const Result& r) {
  if (r.status != Status::solved)
    refuse_here(text("the result is not solved (%s)", to_string(r.status)), "differentiate solved results");
  if (scene.boundary) refuse_here("the scene has a boundary condition", "differentiate a scene with an initial value");
  if (!scene.cones.empty()) refuse_here("friction is on circles", "differentiate a scene with facets");
  if (!scene.free_rows.empty()) refuse_here("the scene has free rows", "use the derivative of dense dynamics");
  if (scene.dynamics->small_state() && scene.dynamics->has_mass())
    refuse_here("the dynamics are dense with a mass matrix", "use the derivative of dense dynamics");
  if (!has_steps_of_march(r))
    refuse_here(text("the result is of method %s", to_string(r.method)), "solve by march, contour or multigrid");
  if (y_may_jump(r))
    refuse_here("not differentiable here: y may jump, and the derivative of the discrete solution is not that of y",
                "differentiate scenes with a continuous y (M of class P)");
  if (scene.f && scene.f_entry != SourceEntry::through_B)
    refuse_here("f does not enter through B", "state f as f = B phi");
  if (r.y.rows() != r.steps + 1 || r.y.cols() != scene.constraints() || r.t.size() != r.steps + 1)
    refuse_here("the result has other rows than its grid", "differentiate a result as solve returned it");
  return scene;
}

// c u. Row k becomes row J + 1 - k; row 0 becomes 0.
RowMatrix in_reversed_time(double c, const RowMatrix& u) {
  RowMatrix result(u.rows(), u.cols());
  result.row(0).setZero();
  result.bottomRows(u.rows() - 1) = c * u.bottomRows(u.rows() - 1).colwise().reverse();
  return result;
}

bool steps_in_modes(const Scene& scene, Method method, Backend& backend) {
  const KroneckerDynamics* d = scene.dynamics->modes();
  return d && !d->both_faces && method == Method::march && backend.fused().linear_march;
}

}  // namespace

SpaceTimeDerivative::SpaceTimeDerivative(const Scene& scene, const Result& result, Backend& backend)
    : scene_(checked_for_all_times(scene, result)),
      backend_(backend),
      J_(result.steps),
      n_(scene.constraints()),
      h_(scene.T / double(J_)),
      y_(result.y),
      active_((result.y.array() > 0).cast<double>()),
      transposed_M_(transposed(scene.M)) {
  if (steps_in_modes(scene, result.method, backend)) {
    stepped_ = std::make_unique<ModalDerivative>(scene, result);
    margin_ = stepped_->margin();
    return;
  }
  if (const double growth = family_.of(scene_.dynamics)->spectrum().abscissa * scene_.T; growth > largest_growth)
    refuse_here(text("states grow by e^%.3g over [0, T]", growth), "use the derivative on the host, or a shorter T");
  hold_sets(result.method);
  const std::vector<Index> first = positive_in(y_, 0);
  set_at_zero_ = at_zero_.take(first, to_dense(scene_.M));
  if (!(at_zero_.condition(set_at_zero_) > smallest_rcond_at_zero))
    refuse_here("not differentiable here: the active constraints at t = 0 do not determine y",
                "remove constraints that repeat each other");
  const SetRounding zero = follow(result.t);
  undecided_ = undecided_at_start(w_, zero, first);
  std::vector<std::vector<Index>> sets;
  for (Index j = 0; j <= J_; ++j) sets.push_back(positive_in(y_, j));
  margin_ = margin_of_sets(y_, w_, zero, result.t,
                           [&](Index j) -> const std::vector<Index>& { return sets[std::size_t(j)]; });
}

SpaceTimeDerivative::~SpaceTimeDerivative() = default;

// Sparse dynamics by lag weights, also where the solve has few poles: K^T is that of the weights.
void SpaceTimeDerivative::hold_sets(Method method) {
  const bool tabulated = !scene_.dynamics->small_state() && !scene_.dynamics->modes();
  const double values = double(J_ + 1) * double(n_) * double(n_);
  if (tabulated && values > most_tabulated)
    refuse_here(text("lag weights of %.3g numbers would be needed", values),
                "differentiate scenes with fewer steps or constraints");
  forward_ = std::make_unique<HeldSets>(scene_, backend_, active_, method, family_,
                                        tabulated ? &make_lag_operator : &make_time_operator);
}

// w of the solution. It has to vanish where y acts.
SetRounding SpaceTimeDerivative::follow(const Vector& t) {
  const DiscreteProblem whole = discretise(scene_, backend_, J_, false, &family_);
  RowMatrix u = y_;
  if (whole.f.size() > 0) u += whole.f.table();
  w_ = forward_->apply(u);
  Vector terms_of_x = w_.cwiseAbs().colwise().maxCoeff();
  const RowMatrix start = scene_.x0.isZero(0) ? RowMatrix::Zero(J_ + 1, n_) : maps().seen(scene_.x0);
  terms_of_x += Vector(start.cwiseAbs().colwise().maxCoeff());
  w_ += start;
  if (whole.rough_response) w_ += *whole.rough_response;
  const double of_states = w_.cwiseAbs().maxCoeff();
  add_products(scene_.M, y_, w_);
  w_ += whole.g.table();
  const double terms = 1e-290 + of_states + w_.cwiseAbs().maxCoeff();
  for (Index j = 0; j <= J_; ++j)
    if (const double off = w_.row(j).cwiseProduct(active_.row(j)).cwiseAbs().maxCoeff();
        !(off <= left_where_y_acts * terms))
      refuse_here(text("not differentiable here: the steps of the grid do not give y of the result at t = %.6g", t[j]),
                  "solve on more steps, with sources that do not jump inside steps");
  return rounding_of_sets(terms_of_x, scene_.M, y_, whole.g.table());
}

const StateMaps& SpaceTimeDerivative::maps() {
  if (!maps_) maps_ = make_state_maps(forward_->problem());
  return *maps_;
}

SolutionChange SpaceTimeDerivative::jvp(const DataChange& c, bool states) {
  for (const auto& [name, matrix] : {std::pair("A", &c.A), {"B", &c.B}, {"N", &c.N}, {"E", &c.E}})
    if (matrix->size() > 0) throw Error(name, "is no datum of this derivative", "ask for x0, f, g and M");
  check_no_b(c.b);
  check_no_restitution(c.restitution);
  check_table("x0", c.x0, scene_.states(), 1);
  check_table("f", c.f, J_ + 1, n_);
  check_table("g", c.g, J_ + 1, n_);
  check_table("M", c.M, n_, n_);
  if (stepped_) return stepped_->jvp(c, states);
  RowMatrix r = c.g.size() > 0 ? c.g : RowMatrix::Zero(J_ + 1, n_);
  if (c.M.size() > 0) r.noalias() += y_ * c.M.transpose();
  Vector terms = r.row(0).cwiseAbs().transpose();
  if (c.x0.size() > 0) {
    r += maps().seen(c.x0);
    terms += scene_.dynamics->observed_terms(c.x0);
  }
  if (c.f.size() > 0) r += forward_->apply(c.f);
  HeldSets::Found found = forward_->solve(r);
  SolutionChange out{std::move(found.y), RowMatrix(), std::move(found.w), RowMatrix()};
  if (!undecided_.empty()) terms += to_dense(scene_.M).cwiseAbs() * out.y.row(0).cwiseAbs().transpose();
  check_change_at_start(undecided_, out.w.row(0).transpose(), terms);
  out.integral = integral_of(out.y, h_);
  if (states)
    out.x = maps().states(c.x0.size() > 0 ? c.x0 : Vector::Zero(scene_.states()),
                          c.f.size() > 0 ? RowMatrix(out.y + c.f) : out.y);
  return out;
}

HeldSets& SpaceTimeDerivative::backward() {
  if (backward_) return *backward_;
  Scene adjoint = scene_;
  adjoint.M = transposed_M_;
  backward_ = std::make_unique<HeldSets>(
      adjoint, backend_, in_reversed_time(1, active_), forward_->method(), family_,
      [this](const DiscreteProblem& p) { return make_transposed_operator(p, forward_->time_operator()); },
      forward_.get());
  return *backward_;
}

TransposedKernel& SpaceTimeDerivative::backward_kernel() {
  if (!backward_kernel_) backward_kernel_ = std::make_unique<TransposedKernel>(backend_, forward_->weights(), J_ + 1);
  return *backward_kernel_;
}

DataChange SpaceTimeDerivative::vjp(const SolutionChange& of, bool by_x0) {
  check_table("y", of.y, J_ + 1, n_);
  check_table("w", of.w, J_ + 1, n_);
  check_table("integral", of.integral, J_ + 1, n_);
  check_table("x", of.x, J_ + 1, scene_.states());
  if (stepped_) return stepped_->vjp(of);
  RowMatrix& eta = eta_;
  if (of.y.size() > 0)
    eta = of.y;
  else
    eta.setZero(J_ + 1, n_);
  DataChange bar;
  if (of.integral.size() > 0) eta += integral_transposed(of.integral, h_);
  if (of.w.size() > 0) add_products(transposed_M_, of.w, eta);
  // What u = y + phi and x0 give to the weighted states.
  const auto [of_u, of_x0] = of.x.size() > 0 ? maps().states_transposed(of.x) : std::pair<RowMatrix, Vector>();
  if (of.x.size() > 0) eta += of_u;
  Vector first = eta.row(0).transpose(), mu(n_);
  if (of.w.size() > 0) {
    bar.f = backward_kernel().apply(of.w);
    eta += bar.f;
  }
  // mu of rows 1 to J. That of row 0, whose y acts on all of them, follows.
  const HeldSets::Found found = backward().solve(in_reversed_time(-1, eta));
  bar.g = in_reversed_time(-1, found.y);
  if (found.driven.size() > 0) {
    RowMatrix driven = in_reversed_time(-1, found.driven);
    driven.row(0) = transposed_start(backend_, *forward_->weights(), bar.g).transpose();
    if (of.w.size() > 0)
      bar.f += driven;
    else
      bar.f = std::move(driven);
  }
  if (of.w.size() > 0) bar.g += of.w;
  if (found.driven.size() == 0) bar.f = backward_kernel().apply(bar.g);
  first += bar.f.row(0).transpose();
  const bool from_one_side = weighs_start(undecided_, first, bar.f.row(0).norm() + first.norm());
  at_zero_.solve_transposed(set_at_zero_, first, mu);
  bar.g.row(0) -= mu.transpose();
  if (of.x.size() > 0) bar.f += of_u;
  if (by_x0) bar.x0 = maps().seen_transposed(bar.g);
  if (by_x0 && of.x.size() > 0) bar.x0 += of_x0;
  bar.M = transposed_product(bar.g, y_, backend_);
  if (from_one_side) leave_out_start(bar, scene_.x0, y_);
  return bar;
}

bool space_time_pays(const Backend& backend, const Scene& scene, const Result& result) {
  const BackendTraits& traits = backend.traits();
  return !traits.one_at_a_time && double(result.steps) * double(scene.constraints()) >= traits.fewest_values;
}

}  // namespace bromwich
