// The passes of ModalDerivative, forward and backward in time.

#include "core/derivatives/modal_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/derivatives/check_table.hpp"
#include "core/derivatives/lcp_terms.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace bromwich {

SolutionChange ModalDerivative::jvp(const DataChange& c, bool states) const {
  for (const auto& [name, matrix] : {std::pair("A", &c.A), {"B", &c.B}, {"N", &c.N}, {"E", &c.E}})
    if (matrix->size() > 0)
      throw Error(name, "is part of the structure of a Kronecker sum", "ask for derivatives by x0, f, g and M");
  check_table("x0", c.x0, m_, 1);
  check_table("f", c.f, J_ + 1, n_);
  check_table("g", c.g, J_ + 1, n_);
  check_table("M", c.M, n_, n_);
  const RowMatrix x0 = c.x0.size() > 0 ? state_modes(c.x0) : RowMatrix();
  SolutionChange out{RowMatrix(J_ + 1, n_), RowMatrix(), RowMatrix(J_ + 1, n_), RowMatrix(J_ + 1, n_)};
  RowMatrix& w = out.w;  // at first what does not come from y and f
  if (c.g.size() > 0)
    w = c.g;
  else
    w.setZero();
  if (c.M.size() > 0) w.noalias() += y_ * c.M.transpose();
  if (x0.size() > 0) w += face_.to_points(start_.response(x0, J_));
  Vector terms = w.row(0).cwiseAbs().transpose();
  RowMatrix u = c.f.size() > 0 ? face_.to_modes(c.f) : RowMatrix::Zero(J_ + 1, n_), v(J_ + 1, n_);
  ModalConvolution::State z = convolution_.state();
  Vector a = Vector::Zero(n_), q = Vector::Zero(n_), dy(n_), driven(n_);
  for (Index j = 0; j <= J_; ++j) {
    const std::vector<Index>& active = responses_.active(sets_[std::size_t(j)]);
    if (j > 0) {
      convolution_.advance(j, u.row(j - 1).data(), z, a);
      a += convolution_.own().cwiseProduct(u.row(j).transpose());
    }
    face_.seen_on(active, a, q);
    for (const Index i : active) q[i] += w(j, i);
    responses_.solve(sets_[std::size_t(j)], q, dy);
    face_.of_set(active, dy, driven);
    u.row(j) += driven.transpose();
    if (j > 0) a += convolution_.own().cwiseProduct(driven);
    v.row(j) = a.transpose();
    out.y.row(j) = dy.transpose();
    if (j > 0)
      out.integral.row(j) = out.integral.row(j - 1) + (h_ / 2) * (out.y.row(j - 1) + out.y.row(j));
    else
      out.integral.row(0).setZero();
  }
  w += face_.to_points(std::move(v));
  add_products(scene_M_, out.y, w);
  terms += M_.cwiseAbs() * out.y.row(0).cwiseAbs().transpose();
  if (x0.size() > 0) terms.array() += (seen_.cwiseAbs().transpose() * x0.cwiseAbs()).norm();
  check_change_at_start(undecided_, w.row(0).transpose(), terms);
  if (states) out.x = states_of(x0, u);
  return out;
}

DataChange ModalDerivative::vjp(const SolutionChange& of) const {
  check_table("y", of.y, J_ + 1, n_);
  check_table("x", of.x, J_ + 1, m_);
  check_table("w", of.w, J_ + 1, n_);
  check_table("integral", of.integral, J_ + 1, n_);
  DataChange bar;
  RowMatrix of_u = RowMatrix::Zero(J_ + 1, n_), of_x0, rho = RowMatrix::Zero(J_ + 1, n_), given;
  if (of.x.size() > 0) std::tie(of_u, of_x0) = states_transposed(of.x);
  if (of.w.size() > 0) {
    rho = face_.to_modes(of.w);
    of_u.bottomRows(J_) += rho.bottomRows(J_) * convolution_.own().asDiagonal();
  }
  // What w and x at any time have of y, without the states that y leads to.
  if (of.x.size() > 0 || of.w.size() > 0) given = face_.to_points(of_u);
  const double of_start = given.size() > 0 ? given.row(0).norm() : 0;
  if (of.w.size() > 0) add_products(transposed_M_, of.w, given);
  bar.g = of.w.size() > 0 ? of.w : RowMatrix::Zero(J_ + 1, n_);
  ModalConvolution::State zeta = convolution_.state();
  Vector b = Vector::Zero(n_), eta(n_), mu(n_), modes = Vector::Zero(n_), later = Vector::Zero(n_);
  for (Index j = J_; j >= 0; --j) {
    const std::vector<Index>& active = responses_.active(sets_[std::size_t(j)]);
    if (j < J_) {
      convolution_.retreat(j, rho.row(j + 1).data(), zeta, b);
      of_u.row(j) += b.transpose();
    }
    eta.setZero();
    face_.seen_on(j > 0 ? active : every_, b, eta);
    const double of_states = j == 0 ? eta.norm() + of_start : 0;
    if (given.size() > 0) eta += given.row(j).transpose();
    if (of.y.size() > 0) eta += of.y.row(j).transpose();
    if (of.integral.size() > 0) {
      eta += h_ / 2 * later;
      later += of.integral.row(j).transpose();
      if (j > 0) eta += h_ / 2 * later;
    }
    if (j == 0) check_gradient_at_start(undecided_, eta, of_states + eta.norm());
    responses_.solve_transposed(sets_[std::size_t(j)], eta, mu);
    face_.of_set(active, mu, modes);
    rho.row(j) -= modes.transpose();
    if (j > 0) of_u.row(j) -= convolution_.own().cwiseProduct(modes).transpose();
    bar.g.row(j) -= mu.transpose();
  }
  bar.f = face_.to_points(std::move(of_u));
  RowMatrix start = start_.transposed(rho);
  if (of_x0.size() > 0) start += of_x0;
  bar.x0 = state_of(start);
  bar.M = transposed_product(bar.g, y_);
  return bar;
}

}  // namespace bromwich
