#include "derivatives/modal_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/result/located.hpp"
#include "core/scene/separable.hpp"
#include "derivatives/lcp_terms.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace bromwich {

namespace {

constexpr double same_y = 1e-7;  ///< of the largest y: what w may leave of the active constraints
constexpr double smallest_condition = 1e-14;

[[noreturn]] void refuse_in_modes(const std::string& found, const std::string& remedy) {
  throw Error("derivative", found, remedy);
}

const KroneckerDynamics& modes_of(const Scene& scene, const Result& r) {
  const KroneckerDynamics* d = scene.dynamics->modes();
  if (!d) refuse_in_modes("the dynamics are no Kronecker sum", "use the derivative of dense dynamics");
  if (d->both_faces)
    refuse_in_modes("contact is on two sides of a Kronecker sum", "use the derivative over all time points");
  if (r.status != Status::solved)
    refuse_in_modes(text("the result is not solved (%s)", to_string(r.status)), "differentiate solved results");
  if (!has_steps_of_march(r))
    refuse_in_modes(text("the result is of method %s", to_string(r.method)), "solve by march, contour or multigrid");
  if (y_may_jump(r))
    refuse_in_modes("not differentiable here: y may jump, and the derivative of the discrete solution is not that of y",
                    "differentiate scenes with a continuous y (M of class P)");
  if (scene.f && scene.f_entry != SourceEntry::through_B)
    refuse_in_modes("f does not enter through B", "state f as f = B phi");
  return *d;
}

RowMatrix sampled(const TimeFunction& function, const Vector& t, Index width) {
  return function ? RowMatrix(sample(function, t, width).table()) : RowMatrix::Zero(t.size(), width);
}

}  // namespace

ModalDerivative::ModalDerivative(const Scene& scene, const Result& result)
    : d_(modes_of(scene, result)),
      scene_M_(scene.M),
      transposed_M_(transposed(scene.M)),
      M_(to_dense(scene.M)),
      J_(result.steps),
      m_(scene.states()),
      n_(scene.constraints()),
      h_(scene.T / double(J_)),
      t_(result.t),
      seen_(d_.across.in_modes(d_.n)),
      states_(d_, h_),
      face_(states_.face()),
      convolution_(d_, h_, scene.T),
      start_(d_, h_),
      y_(result.y),
      x0_(scene.x0) {
  if (y_.rows() != J_ + 1 || y_.cols() != n_ || t_.size() != J_ + 1)
    refuse_in_modes("the result has other rows than its grid", "differentiate a result as solve returned it");
  every_.resize(std::size_t(n_));
  std::iota(every_.begin(), every_.end(), Index(0));
  // W = M + V diag(W_0) V^T.
  const RowMatrix V = face_.to_modes(RowMatrix::Identity(n_, n_));
  const Matrix W = M_ + V * convolution_.own().asDiagonal() * V.transpose();
  sets_.resize(std::size_t(J_) + 1);
  for (Index j = 0; j <= J_; ++j)
    sets_[std::size_t(j)] = j > 0 ? responses_.take(positive_in(y_, j), W) : responses_.take(positive_in(y_, j), M_, 1);
  const RowMatrix g = sampled(scene.g, t_, n_);
  w_ = g + y_ * M_.transpose();
  u_ = y_ + sampled(scene.f, t_, n_);
  const SetRounding zero = rounding_of_sets(follow(states_.modes_of(x0_), u_), scene.M, y_, g);
  undecided_ = undecided_at_start(w_, zero, responses_.active(sets_[0]));
  margin_ = margin_of_sets(y_, w_, zero, t_, [this](Index j) -> const std::vector<Index>& {
    return responses_.active(sets_[std::size_t(j)]);
  });
}

// Adds N x of the states that x0 and u = y + phi give to w, which has to vanish where y acts. Returns the largest
// |(N x)_i| over time.
Vector ModalDerivative::follow(const RowMatrix& x0, const RowMatrix& u) {
  const Index width = face_.width();
  RowMatrix v = start_.response(x0, J_), modes = RowMatrix::Zero(J_ + 1, width);
  modes.leftCols(n_) = u;
  face_.transform(Way::to_modes, modes.leftCols(n_));
  ModalConvolution::State z = convolution_.state();
  Vector a(width), off(n_);
  for (Index j = 1; j <= J_; ++j) {
    const double* before = modes.row(j - 1).data();
    j == 1 ? convolution_.start(before, z, a.data()) : convolution_.advance(before, z, a.data());
    v.row(j) += (a.head(n_) + convolution_.own().cwiseProduct(modes.row(j).head(n_).transpose())).transpose();
  }
  face_.transform(Way::to_points, v);
  w_ += v;
  const double allowed = same_y * (1e-290 + y_.cwiseAbs().maxCoeff());
  for (Index j = 0; j <= J_; ++j) {
    const Index set = sets_[std::size_t(j)];
    if (!(responses_.condition(set) > smallest_condition))
      refuse_in_modes(text("not differentiable here: the active constraints at t = %.6g do not determine y", t_[j]),
                      "remove constraints that repeat each other");
    responses_.solve(set, w_.row(j).transpose(), off);
    if (j > 0 && !(off.norm() <= allowed))
      refuse_in_modes(
          text("not differentiable here: the steps of the grid do not give y of the result at t = %.6g", t_[j]),
          "solve on more steps, with sources that do not jump inside steps");
  }
  return v.cwiseAbs().colwise().maxCoeff();
}

// Changes of w and x.
SolutionChange ModalDerivative::with_y_held(const KroneckerChange& c, bool states) const {
  SolutionChange direct;
  direct.w =
      face_.to_points(states_.change(c, states_.modes_of(x0_), face_.to_modes(u_), states ? &direct.x : nullptr));
  return direct;
}

SolutionChange ModalDerivative::jvp(const KroneckerChange& c, bool states) const {
  SolutionChange direct = with_y_held(c, states);
  DataChange as_g;
  as_g.g = std::move(direct.w);
  SolutionChange out = jvp(as_g, states);
  if (states) out.x += direct.x;
  return out;
}

double ModalDerivative::along(const KroneckerChange& c, const SolutionChange& of, const DataChange& gradient) const {
  const SolutionChange direct = with_y_held(c, of.x.size() > 0);
  if (gradient.g.size() == 0)
    refuse_in_modes("not differentiable here: y_i = w_i = 0 at t = 0, and the gradient by w(0) is one-sided",
                    "use jvp for changes that leave w_i");
  return gradient.g.cwiseProduct(direct.w).sum() + (of.x.size() > 0 ? of.x.cwiseProduct(direct.x).sum() : 0);
}

}  // namespace bromwich
