// The passes of ModalDerivative, forward and backward in time, over blocks of time points: what the cache holds needs
// no array over all of them.

#include "derivatives/modal_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/first_touch.hpp"
#include "core/base/text.hpp"
#include "derivatives/check_table.hpp"
#include "derivatives/lcp_terms.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

constexpr Index block = 64;  ///< time points

// (J+1) x n values that a pass will write.
RowMatrix to_be_written(Index rows, Index n) {
  RowMatrix table(rows, n);
  ask_for_pages(table.data(), std::size_t(table.size()));
  return table;
}

static_assert(block % ModalStart::together == 0);

}  // namespace

// What a pass holds of time points `first` to `first + count - 1`, in modes that are filled up with zeros, and of the
// step between them.
struct ModalDerivative::Pass {
  Pass(const ModalConvolution& K, Index n)
      : u(RowMatrix::Zero(block, K.width())),
        v(RowMatrix::Zero(block, K.width())),
        z(K.state()),
        next(Vector::Zero(K.width())),
        of_set(Vector::Zero(K.width())),
        q(Vector::Zero(n)),
        y(Vector::Zero(n)) {}

  Index first = 0, count = 0;
  bool from_one_side = false;  ///< see weighs_start
  RowMatrix u, v;              ///< y + phi and v; backward what u gets, and ρ
  ModalConvolution::State z;
  Vector next;    ///< a or b of the next step
  Vector of_set;  ///< modes of y or mu
  Vector q, y;    ///< n: of a step, y or mu
};

SolutionChange ModalDerivative::jvp(const DataChange& c, bool states) const {
  for (const auto& [name, matrix] : {std::pair("A", &c.A), {"B", &c.B}, {"N", &c.N}, {"E", &c.E}})
    if (matrix->size() > 0)
      throw Error(name, "is part of the structure of a Kronecker sum", "ask for derivatives by x0, f, g and M");
  check_no_b(c.b);
  check_no_restitution(c.restitution);
  check_table("x0", c.x0, m_, 1);
  check_table("f", c.f, J_ + 1, n_);
  check_table("g", c.g, J_ + 1, n_);
  check_table("M", c.M, n_, n_);
  const RowMatrix x0 = c.x0.size() > 0 ? states_.modes_of(c.x0) : RowMatrix();
  SolutionChange out{to_be_written(J_ + 1, n_), RowMatrix(), to_be_written(J_ + 1, n_), to_be_written(J_ + 1, n_)};
  RowMatrix of_x0 = x0.size() > 0 ? start_.terms(x0) : RowMatrix(), all_u(states ? J_ + 1 : 0, n_);
  Vector terms;  // that add up to w(0)
  Pass at(convolution_, n_);
  for (at.first = 0; at.first <= J_; at.first += block) {
    at.count = std::min(block, J_ + 1 - at.first);
    auto w = out.w.middleRows(at.first, at.count);
    if (c.g.size() > 0)
      w = c.g.middleRows(at.first, at.count);
    else
      w.setZero();
    if (c.M.size() > 0) add_rows_times(y_.middleRows(at.first, at.count), c.M, w);
    if (at.first == 0) terms = w.row(0).cwiseAbs().transpose();
    if (c.f.size() > 0) {
      at.u.topLeftCorner(at.count, n_) = c.f.middleRows(at.first, at.count);
      face_.transform(Way::to_modes, at.u.topLeftCorner(at.count, n_));
    } else {
      at.u.setZero();
    }
    at.v.setZero();
    for (Index i = 0; of_x0.size() > 0 && i < at.count; i += ModalStart::together)
      start_.advance(at.first + i, of_x0, at.v.middleRows(i, ModalStart::together));
    step_forward(at, out);
    if (states) all_u.middleRows(at.first, at.count) = at.u.topLeftCorner(at.count, n_);
    face_.transform(Way::to_points, at.v.topLeftCorner(at.count, n_));
    w += at.v.topLeftCorner(at.count, n_);
    for (Index j = at.first; j < at.first + at.count; ++j)
      add_product(scene_M_, out.y.row(j).data(), out.w.row(j).data());
  }
  terms += M_.cwiseAbs() * out.y.row(0).cwiseAbs().transpose();
  if (x0.size() > 0) terms.array() += (seen_.cwiseAbs().transpose() * x0.cwiseAbs()).norm();
  check_change_at_start(undecided_, out.w.row(0).transpose(), terms);
  if (states) out.x = states_.states(x0, all_u);
  return out;
}

// y and its integral on a block. u has phi, v the response to x0, w of `out` the other changes of w; u and v get what
// y gives.
void ModalDerivative::step_forward(Pass& at, SolutionChange& out) const {
  const auto own = convolution_.own().transpose();
  for (Index i = 0; i < at.count; ++i) {
    const Index j = at.first + i, set = sets_[std::size_t(j)];
    auto u = at.u.row(i), v = at.v.row(i);
    if (j > 0) v.head(n_) += at.next.head(n_).transpose() + own.cwiseProduct(u.head(n_));
    const std::vector<Index>& active = responses_.active(set);
    face_.seen_on(active, v.data(), at.q);
    for (const Index l : active) at.q[l] += out.w(j, l);
    responses_.solve(set, at.q, at.y);
    face_.of_set(active, at.y, at.of_set.data());
    u += at.of_set.transpose();
    if (j > 0) v.head(n_) += own.cwiseProduct(at.of_set.head(n_).transpose());
    out.y.row(j) = at.y.transpose();
    if (j > 0)
      out.integral.row(j) = out.integral.row(j - 1) + (h_ / 2) * (out.y.row(j - 1) + out.y.row(j));
    else
      out.integral.row(0).setZero();
    if (j == 0)
      convolution_.start(u.data(), at.z, at.next.data());
    else
      convolution_.advance(u.data(), at.z, at.next.data());
  }
}

DataChange ModalDerivative::vjp(const SolutionChange& of) const {
  check_table("y", of.y, J_ + 1, n_);
  check_table("x", of.x, J_ + 1, m_);
  check_table("w", of.w, J_ + 1, n_);
  check_table("integral", of.integral, J_ + 1, n_);
  DataChange bar;
  bar.g = to_be_written(J_ + 1, n_);
  bar.f = to_be_written(J_ + 1, n_);
  bar.M = Matrix::Zero(n_, n_);
  RowMatrix of_u, of_x0, q = start_.nothing(), given;
  if (of.x.size() > 0) std::tie(of_u, of_x0) = states_.transposed(of.x);
  Vector later = Vector::Zero(n_);  // weights of the integrals over [0, t_k], k > j
  Pass at(convolution_, n_);
  for (at.first = J_ / block * block; at.first >= 0; at.first -= block) {
    at.count = std::min(block, J_ + 1 - at.first);
    auto u = at.u.topLeftCorner(at.count, n_), rho = at.v.topLeftCorner(at.count, n_);
    at.u.setZero();
    at.v.setZero();
    if (of.x.size() > 0) u = of_u.middleRows(at.first, at.count);
    if (of.w.size() > 0) {
      rho = of.w.middleRows(at.first, at.count);
      face_.transform(Way::to_modes, rho);
      const Index later_rows = at.first > 0 ? at.count : at.count - 1;  // v_0 = 0
      u.bottomRows(later_rows) += rho.bottomRows(later_rows) * convolution_.own().asDiagonal();
    }
    // What w and x at any time have of y, without the states that y leads to.
    if (of.x.size() > 0 || of.w.size() > 0) {
      given = u;
      face_.transform(Way::to_points, given);
    }
    step_backward(at, of, given, later, bar);
    for (Index i = (at.count - 1) / ModalStart::together * ModalStart::together; i >= 0; i -= ModalStart::together)
      start_.retreat(at.first + i, at.v.middleRows(i, std::min(ModalStart::together, at.count - i)), q);
    face_.transform(Way::to_points, u);
    bar.f.middleRows(at.first, at.count) = u;
    add_transposed_product(bar.g.middleRows(at.first, at.count), y_.middleRows(at.first, at.count), bar.M);
  }
  RowMatrix start = start_.gradient(q);
  if (of_x0.size() > 0) start += of_x0;
  bar.x0 = states_.state_of(std::move(start));
  if (at.from_one_side) leave_out_start(bar, x0_, y_);
  return bar;
}

// mu and rho on a block. u has what w and x give, `given` the same at the points or nothing, v has w in modes.
void ModalDerivative::step_backward(Pass& at, const SolutionChange& of, const RowMatrix& given, Vector& later,
                                    DataChange& bar) const {
  const auto own = convolution_.own().transpose();
  Vector& eta = at.q;
  for (Index i = at.count - 1; i >= 0; --i) {
    const Index j = at.first + i, set = sets_[std::size_t(j)];
    auto u = at.u.row(i), rho = at.v.row(i);
    const std::vector<Index>& active = responses_.active(set);
    u += at.next.transpose();
    eta.setZero();
    face_.seen_on(j > 0 ? active : every_, at.next.data(), eta);
    const double of_states = j > 0 ? 0 : eta.norm() + (given.size() > 0 ? given.row(i).norm() : 0);
    if (given.size() > 0) eta += given.row(i).transpose();
    if (of.w.size() > 0) add_product(transposed_M_, of.w.row(j).data(), eta.data());
    if (of.y.size() > 0) eta += of.y.row(j).transpose();
    if (of.integral.size() > 0) {
      eta += h_ / 2 * later;
      later += of.integral.row(j).transpose();
      if (j > 0) eta += h_ / 2 * later;
    }
    if (j == 0) at.from_one_side = weighs_start(undecided_, eta, of_states + eta.norm());
    responses_.solve_transposed(set, eta, at.y);
    face_.of_set(active, at.y, at.of_set.data());
    rho -= at.of_set.transpose();
    if (j > 0) u.head(n_) -= own.cwiseProduct(at.of_set.head(n_).transpose());
    if (of.w.size() > 0)
      bar.g.row(j) = of.w.row(j) - at.y.transpose();
    else
      bar.g.row(j) = -at.y.transpose();
    if (j > 1)
      convolution_.advance(rho.data(), at.z, at.next.data());
    else if (j == 1)
      convolution_.finish(rho.data(), at.z, at.next.data());
  }
}

}  // namespace bromwich
