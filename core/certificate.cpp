#include "core/certificate.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double most_operations = 2e9;  ///< of a pass over the state; beyond, no magnification is computed

// dy of the active set of a row of y for a given C dz; the factorization is kept while the set stays.
class ActiveResponse {
 public:
  explicit ActiveResponse(const Matrix& implicit) : implicit_(implicit), response_(Vector::Zero(implicit.rows())) {}

  const Vector& operator()(const Vector& y, const Vector& seen) {
    std::vector<Index> S;
    for (Index i = 0; i < y.size(); ++i)
      if (y[i] > 0) S.push_back(i);
    if (S != support_) {
      support_ = S;
      if (!S.empty()) lu_.compute(implicit_(S, S));
    }
    response_.setZero();
    if (!S.empty()) response_(S) = -lu_.solve(seen(S));
    return response_;
  }

 private:
  Matrix implicit_;
  std::vector<Index> support_;
  Eigen::CompleteOrthogonalDecomposition<Matrix> lu_;  // duplicated constraints leave M_SS singular
  Vector response_;
};

// Fixed, with parts in all directions.
Vector perturbation(Index m) {
  Vector dz(m);
  for (Index i = 0; i < m; ++i) dz[i] = std::cos(1.0 + 2.399963 * double(i));
  return dz.normalized();
}

}  // namespace

Magnification magnification(const DiscreteProblem& p, Rule rule, const RowMatrix& y) {
  const DenseDynamics* d = p.dense();
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  if (!d || double(p.J) * (2 * m * m + 4 * m * n) > most_operations || !y.allFinite()) return {NAN, NAN};
  const StepOperators step = step_operators(d->A, rule, p.h);
  const DenseRecurrence r = dense_recurrence(*d, step);
  const RowMatrix input = state_input(p, y);
  ActiveResponse response(to_dense(p.scene.M) + r.w0);
  Vector dz = perturbation(p.scene.states()), x = p.scene.x0;
  double log_growth = 0, least = 0, most = 0, error = epsilon * x.norm(), worst = error, size = x.norm();
  for (Index j = 1; j <= p.J; ++j) {
    x = step.decay * x + step.left * input.row(j - 1).transpose() + step.right * input.row(j).transpose();
    const Vector dy = response(y.row(j).transpose(), r.output * dz);
    dz = (r.decay * dz + r.input * dy).eval();
    const double rho = dz.norm();
    if (!(rho > 1e-290) || !std::isfinite(rho)) {  // the perturbation is gone: start another one
      dz = perturbation(p.scene.states());
      least = std::min(least, log_growth);
      continue;
    }
    dz /= rho;
    size = std::max(size, x.norm());
    error = rho * error + epsilon * x.norm();
    worst = std::max(worst, error);
    log_growth += std::log(rho);
    least = std::min(least, log_growth);
    most = std::max(most, log_growth - least);
  }
  const double own = size / std::max(p.scene.x0.norm(), 1e-6 * size);
  return {std::exp(std::min(most, 700.0)) / std::max(own, 1.0), size > 0 ? worst / size : 0};
}

Change change_when_halved(const RowMatrix& coarse, const RowMatrix& fine, Index last) {
  double largest = 0, size = 0, sum = 0, whole = 0;
  for (Index j = 1; j <= last; ++j) {
    const auto difference = (coarse.row(j) - fine.row(2 * j)).cwiseAbs();
    largest = std::max(largest, difference.maxCoeff<Eigen::PropagateNaN>());
    size = std::max(size, fine.row(2 * j).cwiseAbs().maxCoeff());
    sum += difference.sum();
    whole += fine.row(2 * j).cwiseAbs().sum();
  }
  const double least = 1e-300;
  return {largest / std::max(size, least), sum / std::max(whole, least)};
}

}  // namespace bromwich
