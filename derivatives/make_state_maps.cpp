#include "derivatives/make_state_maps.hpp"

#include "derivatives/contour_states.hpp"
#include "derivatives/kronecker_states.hpp"
#include "derivatives/modal_start.hpp"

namespace bromwich {

namespace {

class DenseStateMaps final : public StateMaps {
 public:
  explicit DenseStateMaps(const DiscreteProblem& p) : d_(*p.small_state()), J_(p.J) {
    const auto step = state_step(p, Rule::exponential);
    E_ = step->decay;
    left_ = step->left * d_.B;
    right_ = step->right * d_.B;
  }

  RowMatrix seen(const Vector& x0) const override {
    RowMatrix rows(J_ + 1, d_.N.rows());
    Vector x = x0;
    for (Index j = 0; j <= J_; ++j, x = (E_ * x).eval()) rows.row(j) = (d_.N * x).transpose();
    return rows;
  }

  Vector seen_transposed(const RowMatrix& rho) const override {
    Vector q = Vector::Zero(E_.rows());
    for (Index j = J_; j >= 0; --j) q = (E_.transpose() * q + d_.N.transpose() * rho.row(j).transpose()).eval();
    return q;
  }

  RowMatrix states(const Vector& x0, const RowMatrix& u) const override {
    RowMatrix x(J_ + 1, E_.rows());
    x.row(0) = x0.transpose();
    x.bottomRows(J_) = u.topRows(J_) * left_.transpose() + u.bottomRows(J_) * right_.transpose();
    for (Index j = 1; j <= J_; ++j) x.row(j) += x.row(j - 1) * E_.transpose();
    return x;
  }

  std::pair<RowMatrix, Vector> states_transposed(const RowMatrix& of_x) const override {
    RowMatrix q = of_x;
    for (Index j = J_; j-- > 0;) q.row(j) += q.row(j + 1) * E_;
    RowMatrix u = RowMatrix::Zero(J_ + 1, d_.N.rows());
    u.topRows(J_) = q.bottomRows(J_) * left_;
    u.bottomRows(J_) += q.bottomRows(J_) * right_;
    return {std::move(u), q.row(0).transpose()};
  }

 private:
  const DenseDynamics& d_;
  Index J_;
  Matrix E_, left_, right_;  ///< e^{hA}, L B, R B
};

class KroneckerStateMaps final : public StateMaps {
 public:
  explicit KroneckerStateMaps(const DiscreteProblem& p) : J_(p.J), states_(*p.modes(), p.h), start_(*p.modes(), p.h) {}

  RowMatrix seen(const Vector& x0) const override {
    return states_.face().to_points(start_.response(states_.modes_of(x0), J_));
  }
  Vector seen_transposed(const RowMatrix& rho) const override {
    return states_.state_of(start_.transposed(states_.face().to_modes(rho)));
  }
  RowMatrix states(const Vector& x0, const RowMatrix& u) const override {
    return states_.states(states_.modes_of(x0), states_.face().to_modes(u));
  }
  std::pair<RowMatrix, Vector> states_transposed(const RowMatrix& of_x) const override {
    auto [u, x0] = states_.transposed(of_x);
    return {states_.face().to_points(std::move(u)), states_.state_of(std::move(x0))};
  }

 private:
  Index J_;
  KroneckerStates states_;
  ModalStart start_;
};

}  // namespace

std::unique_ptr<StateMaps> make_state_maps(const DiscreteProblem& p) {
  if (p.modes() && !p.modes()->both_faces) return std::make_unique<KroneckerStateMaps>(p);
  if (p.small_state()) return std::make_unique<DenseStateMaps>(p);
  return std::make_unique<ContourStates>(p);
}

}  // namespace bromwich
