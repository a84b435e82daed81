#include "core/derivatives/modal_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/numerics/phi.hpp"
#include "core/numerics/sine_basis.hpp"
#include "core/scene/separable.hpp"

#include <algorithm>
#include <cmath>

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
  if (r.status != Status::solved)
    refuse_in_modes(text("the result is not solved (%s)", to_string(r.status)), "differentiate solved results");
  if (r.method != Method::march && r.method != Method::contour && r.method != Method::multigrid)
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

std::vector<Index> positive(const RowMatrix& y, Index j) {
  std::vector<Index> S;
  for (Index i = 0; i < y.cols(); ++i)
    if (y(j, i) > 0) S.push_back(i);
  return S;
}

}  // namespace

ModalDerivative::ModalDerivative(const Scene& scene, const Result& result)
    : d_(modes_of(scene, result)),
      M_(to_dense(scene.M)),
      across_(d_.across.modes()),
      J_(result.steps),
      m_(scene.states()),
      n_(scene.constraints()),
      K_(d_.across.points),
      h_(scene.T / double(J_)),
      t_(result.t),
      seen_(d_.across.in_modes(d_.n)),
      y_(result.y) {
  if (y_.rows() != J_ + 1 || y_.cols() != n_ || t_.size() != J_ + 1)
    refuse_in_modes("the result has other rows than its grid", "differentiate a result as solve returned it");
  for (const Index points : d_.face_extents()) sines_.push_back(sine_matrix(points));
  const Vector mu = d_.face_eigenvalues(), nu = d_.across.eigenvalues(), b = d_.across.in_modes(d_.b);
  for (RowMatrix* table : {&E_, &Lb_, &Rb_}) table->resize(K_, n_);
  for (Index k = 0; k < K_; ++k) {
    const ArrayPhi phi = array_phi(h_ * (mu.array() + nu[k]));
    E_.row(k) = phi.exponential;
    Lb_.row(k) = h_ * b[k] * (phi.phi1 - phi.phi2);
    Rb_.row(k) = h_ * b[k] * phi.phi2;
  }
  x0_ = state_modes(scene.x0);
  Matrix W = M_;
  const Vector first = (seen_.transpose() * Rb_).transpose();
  for (Index i = 0; i < n_; ++i)  // S diag(first) S, column by column
    W.col(i) += face_modes(first.cwiseProduct(face_modes(Vector::Unit(n_, i))));
  sets_.resize(std::size_t(J_) + 1);
  for (Index j = 0; j <= J_; ++j)
    sets_[std::size_t(j)] = j > 0 ? responses_.take(positive(y_, j), W) : responses_.take(positive(y_, j), M_, 1);
  w_ = sampled(scene.g, t_, n_) + y_ * M_.transpose();
  follow(result, sampled(scene.f, t_, n_));
  margin_ = margin_of_sets(
      y_, w_, t_, [this](Index j) -> const std::vector<Index>& { return responses_.active(sets_[std::size_t(j)]); });
}

// Between n values on the face and its modes: one product for each direction.
void ModalDerivative::to_modes(double* values) const {
  Index outer = 1, inner = n_;
  for (const Matrix& S : sines_) {
    inner /= S.rows();
    for (Index i = 0; i < outer; ++i) {
      Eigen::Map<RowMatrix> block(values + i * S.rows() * inner, S.rows(), inner);
      block = (S * block).eval();
    }
    outer *= S.rows();
  }
}

Vector ModalDerivative::face_modes(Vector v) const {
  to_modes(v.data());
  return v;
}

// K x n modes of m values, face points slowest.
RowMatrix ModalDerivative::state_modes(const Vector& x) const {
  RowMatrix modes = across_.transpose() * Eigen::Map<const RowMatrix>(x.data(), n_, K_).transpose();
  for (Index k = 0; k < K_; ++k) to_modes(modes.row(k).data());
  return modes;
}

Vector ModalDerivative::state_of(const RowMatrix& modes) const {
  RowMatrix lines = modes;
  for (Index k = 0; k < K_; ++k) to_modes(lines.row(k).data());
  const RowMatrix x = lines.transpose() * across_.transpose();
  return Eigen::Map<const Vector>(x.data(), m_);
}

// N x.
Vector ModalDerivative::see(const RowMatrix& modes) const {
  return face_modes((seen_.transpose() * modes).transpose());
}

// w of the states that y gives: it has to vanish where y acts.
void ModalDerivative::follow(const Result& result, const RowMatrix& phi) {
  const double allowed = same_y * (1e-290 + result.y.cwiseAbs().maxCoeff());
  RowMatrix x = x0_;
  Vector left = face_modes((y_.row(0) + phi.row(0)).transpose()), off(n_);
  for (Index j = 0; j <= J_; ++j) {
    const Index set = sets_[std::size_t(j)];
    if (!(responses_.condition(set) > smallest_condition))
      refuse_in_modes(text("not differentiable here: the active constraints at t = %.6g do not determine y", t_[j]),
                      "remove constraints that repeat each other");
    if (j > 0) {
      const Vector right = face_modes((y_.row(j) + phi.row(j)).transpose());
      x.array() = E_.array() * x.array() + Lb_.array().rowwise() * left.transpose().array() +
                  Rb_.array().rowwise() * right.transpose().array();
      left = right;
    }
    w_.row(j) += see(x).transpose();
    responses_.solve(set, w_.row(j).transpose(), off);
    if (j > 0 && !(off.norm() <= allowed))
      refuse_in_modes(
          text("not differentiable here: the steps of the grid do not give y of the result at t = %.6g", t_[j]),
          "solve on more steps, with sources that do not jump inside steps");
  }
}

void ModalDerivative::check(const char* name, Index rows, Index columns, Index expected_rows,
                            Index expected_columns) const {
  if (rows * columns == 0 || (rows == expected_rows && columns == expected_columns)) return;
  throw Error(name, text("found %ld x %ld", long(rows), long(columns)),
              text("give %ld x %ld", long(expected_rows), long(expected_columns)));
}

SolutionChange ModalDerivative::jvp(const DataChange& c, bool states) const {
  for (const auto& [name, matrix] : {std::pair("A", &c.A), {"B", &c.B}, {"N", &c.N}, {"E", &c.E}})
    if (matrix->size() > 0)
      throw Error(name, "is part of the structure of a Kronecker sum", "ask for derivatives by x0, f, g and M");
  check("x0", c.x0.size(), 1, m_, 1);
  check("f", c.f.rows(), c.f.cols(), J_ + 1, n_);
  check("g", c.g.rows(), c.g.cols(), J_ + 1, n_);
  check("M", c.M.rows(), c.M.cols(), n_, n_);
  RowMatrix fixed = c.g.size() > 0 ? c.g : RowMatrix::Zero(J_ + 1, n_);
  if (c.M.size() > 0) fixed += y_ * c.M.transpose();
  SolutionChange out{RowMatrix::Zero(J_ + 1, n_), RowMatrix(), RowMatrix(J_ + 1, n_), RowMatrix::Zero(J_ + 1, n_)};
  if (states) out.x.resize(J_ + 1, m_);
  RowMatrix x = c.x0.size() > 0 ? state_modes(c.x0) : RowMatrix::Zero(K_, n_);
  Vector dy(n_), left = Vector::Zero(n_), terms;  // terms: of the change of w(0)
  for (Index j = 0; j <= J_; ++j) {
    const Vector given = c.f.size() > 0 ? face_modes(c.f.row(j).transpose()) : Vector(Vector::Zero(n_));
    if (j > 0)
      x.array() = E_.array() * x.array() + Lb_.array().rowwise() * left.transpose().array() +
                  Rb_.array().rowwise() * given.transpose().array();
    Vector w = see(x) + fixed.row(j).transpose();
    if (j == 0)
      terms = Vector::Constant(n_, (seen_.cwiseAbs().transpose() * x.cwiseAbs()).norm()) +
              fixed.row(0).cwiseAbs().transpose();
    responses_.solve(sets_[std::size_t(j)], w, dy);
    const Vector driven = face_modes(dy);
    if (j == 0) terms += M_.cwiseAbs() * dy.cwiseAbs();
    if (j > 0) {
      x.array() += Rb_.array().rowwise() * driven.transpose().array();
      w = see(x) + fixed.row(j).transpose();
    }
    left = given + driven;
    out.y.row(j) = dy.transpose();
    out.w.row(j) = (w + M_ * dy).transpose();
    if (states) out.x.row(j) = state_of(x).transpose();
    if (j > 0) out.integral.row(j) = out.integral.row(j - 1) + (h_ / 2) * (out.y.row(j - 1) + out.y.row(j));
  }
  check_change_at_start(undecided_at_start(y_, w_, responses_.active(sets_[0])), out.w.row(0).transpose(), terms);
  return out;
}

DataChange ModalDerivative::vjp(const SolutionChange& of) const {
  check("y", of.y.rows(), of.y.cols(), J_ + 1, n_);
  check("x", of.x.rows(), of.x.cols(), J_ + 1, m_);
  check("w", of.w.rows(), of.w.cols(), J_ + 1, n_);
  check("integral", of.integral.rows(), of.integral.cols(), J_ + 1, n_);
  DataChange bar;
  bar.f = bar.g = RowMatrix::Zero(J_ + 1, n_);
  RowMatrix next = RowMatrix::Zero(K_, n_);  // q_{j+1}
  Vector later = Vector::Zero(n_), mu(n_), of_w = Vector::Zero(n_);
  const auto collect = [](const RowMatrix& weights, const RowMatrix& q) {
    return Vector(weights.cwiseProduct(q).colwise().sum().transpose());
  };
  for (Index j = J_; j >= 0; --j) {
    Vector of_u = collect(Lb_, next);
    if (of.w.size() > 0) of_w = of.w.row(j).transpose();
    next.array() *= E_.array();  // p
    if (of.w.size() > 0) next += seen_ * face_modes(of_w).transpose();
    if (of.x.size() > 0) next += state_modes(of.x.row(j).transpose());
    Vector eta = face_modes(j > 0 ? Vector(of_u + collect(Rb_, next)) : of_u);
    const double driven = eta.norm();
    if (of.w.size() > 0) eta += M_.transpose() * of_w;
    if (of.y.size() > 0) eta += of.y.row(j).transpose();
    if (of.integral.size() > 0) {
      eta += h_ / 2 * later;
      later += of.integral.row(j).transpose();
      if (j > 0) eta += h_ / 2 * later;
    }
    if (j == 0)
      check_gradient_at_start(undecided_at_start(y_, w_, responses_.active(sets_[0])), eta, driven + eta.norm());
    responses_.solve_transposed(sets_[std::size_t(j)], eta, mu);
    next -= seen_ * face_modes(mu).transpose();  // q_j
    if (j > 0) of_u += collect(Rb_, next);
    bar.g.row(j) = (of_w - mu).transpose();
    bar.f.row(j) = face_modes(of_u).transpose();
  }
  bar.x0 = state_of(next);
  bar.M = bar.g.transpose() * y_;
  return bar;
}

}  // namespace bromwich
