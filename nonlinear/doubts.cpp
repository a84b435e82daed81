#include "nonlinear/doubts.hpp"

#include "core/base/text.hpp"
#include "core/dynamics/dense.hpp"
#include "nonlinear/exponential_step.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// Contacts multiply the errors of steps by a hundred and more (certification.cpp: doubtful_growth), so that this one is
// small: 0.1 of a state in the end.
constexpr double doubtful_sum = 1e-3;         ///< of a state: its local errors together
constexpr double unresolved_impulse = 0.1;    ///< of a state, by a step next to which the active set is another
constexpr double least_share_of_kind = 1e-3;  ///< of the largest component: what errors of one are relative to

Vector sizes_of(const RowMatrix& rows) {
  const Vector largest = rows.cwiseAbs().colwise().maxCoeff();
  return largest.cwiseMax(std::max(least_share_of_kind * (largest.size() > 0 ? largest.maxCoeff() : 0), 1e-290));
}

class Rows {
 public:
  Rows(const NonlinearScene& scene, const NonlinearResult& r, const std::vector<double>& breaks)
      : r_(r),
        d_(*scene.linear.dynamics->small_state()),
        J_(r.t.size() - 1),
        h_(scene.linear.T / double(J_)),
        driven_(r.y * d_.B.transpose()),
        size_(sizes_of(r.x)),
        whole_(std::size_t(J_) + 1, true) {
    for (const double b : breaks)
      for (Index j = std::max<Index>(Index(b / h_) - 1, 0); j <= std::min(Index(b / h_) + 2, J_); ++j)
        whole_[std::size_t(j)] = false;
    F_ = driven_;
    Vector value(r.x.cols());
    for (Index j = 0; scene.phi && j <= J_; ++j) {
      value.setZero();
      scene.phi(r.t[j], r.x.row(j).transpose(), r.y.row(j).transpose(), value);
      F_.row(j) += value.transpose();
    }
  }

  // Of all steps together, the largest share of a state.
  double local_errors() const {
    const ExponentialStep one = make_exponential_step(d_.A, h_, StepRule::linear),
                          two = make_exponential_step(d_.A, 2 * h_, StepRule::linear);
    const Matrix &E = one.propagators[0], &L = one.left[0], &W = one.weights[0][0];
    const Matrix before = (two.left[0] - E * L).transpose(), middle = (E * W + L).transpose(),
                 after = (two.weights[0][0] - W).transpose();
    const RowMatrix tau =
        F_.topRows(J_ - 1) * before - F_.middleRows(1, J_ - 1) * middle + F_.bottomRows(J_ - 1) * after;
    Vector sum = Vector::Zero(size_.size());
    for (Index j = 1; j < J_; ++j) {
      if (!whole_[std::size_t(j)]) continue;
      if (!r_.continuous && (changes(j) || changes(j + 1)))
        sum += h_ / 2 * (driven_.row(j) - driven_.row(j - 1)).cwiseAbs().transpose();
      else
        sum += tau.row(j - 1).cwiseAbs().transpose() / 6;  // steps are in two of them
    }
    return sum.cwiseQuotient(size_).maxCoeff();
  }

  double impulse() const {
    double largest = 0;
    for (Index j = 1; j < J_; ++j)
      if (changes(j) || changes(j + 1))
        largest = std::max(largest, h_ * driven_.row(j).cwiseAbs().transpose().cwiseQuotient(size_).maxCoeff());
    return largest;
  }

  // The step from t_j in which a constraint may have been met; -1: none.
  Index hidden_contact() const {
    for (Index i = 0; i < r_.w.cols(); ++i)
      for (Index j = 1; j + 2 <= J_; ++j) {
        if (!whole_[std::size_t(j)] || !(r_.w(j, i) > 0) || !(r_.w(j + 1, i) > 0)) continue;
        const double left = r_.w(j, i) - r_.w(j - 1, i), right = r_.w(j + 2, i) - r_.w(j + 1, i);  // a step each
        if (!(left < 0) || !(right > 0)) continue;
        const double place = (r_.w(j + 1, i) - right - r_.w(j, i)) / (left - right);
        if (place > 0 && place < 1 && r_.w(j, i) + place * left < 0) return j;
      }
    return -1;
  }

 private:
  bool changes(Index j) const { return ((r_.y.row(j).array() > 0) != (r_.y.row(j - 1).array() > 0)).any(); }

  const NonlinearResult& r_;
  const DenseDynamics& d_;
  Index J_;
  double h_;
  RowMatrix driven_, F_;  // B y, and with phi
  Vector size_;
  std::vector<bool> whole_;  // rows that no division is near
};

}  // namespace

std::string doubts_of(const NonlinearScene& scene, const NonlinearResult& result, const std::vector<double>& breaks) {
  if (result.t.size() < 4 || result.x.cols() == 0) return "";
  const Rows rows(scene, result, breaks);
  if (rows.impulse() > unresolved_impulse) return "a constraint is active for a few steps only, and strongly";
  if (const double sum = rows.local_errors(); !(sum <= doubtful_sum))
    return text("errors of the steps add up to %.1e of a state", sum);
  if (const Index j = rows.hidden_contact(); j >= 0)
    return text("a constraint may be met inside the step from t = %.6g", result.t[j]);
  return "";
}

}  // namespace bromwich
