#include "core/certificate.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <set>

namespace bromwich {

namespace {

constexpr double most_certified_operations = 2e9;  ///< of a pass over the state; beyond, no magnification is computed

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

bool same_set(const RowMatrix& y, Index a, Index b) { return ((y.row(a).array() > 0) == (y.row(b).array() > 0)).all(); }

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
  if (!d || double(p.J) * (3 * m * m + 4 * m * n) > most_certified_operations || !y.allFinite())
    return {NAN, NAN, NAN, NAN, NAN, {}};
  const std::shared_ptr<const StepOperators> operators = state_step(p, rule);
  const StepOperators& step = *operators;
  const DenseRecurrence r = dense_recurrence(*d, step);
  const RowMatrix input = state_input(p, y), driven = y * d->B.transpose(),
                  x = dense_states(step, p.scene.x0, input, rule == Rule::exponential ? p.defects.get() : nullptr);
  const RowMatrix terms = input * step.right.transpose();
  Magnification result;
  const Vector largest = x.cwiseAbs().colwise().maxCoeff().transpose();
  result.scale = largest.cwiseMax(1e-8 * largest.maxCoeff()).cwiseMax(1e-290);
  const auto norm = [&](const auto& v) { return v.cwiseQuotient(result.scale).norm(); };

  ActiveResponse response(to_dense(p.scene.M) + r.w0);
  const Vector first = perturbation(p.scene.states()).cwiseProduct(result.scale);
  Vector dz = first / norm(first);
  double size = norm(p.scene.x0), rounding = epsilon * size, unit = 0, log_growth = 0, least = 0, most = 0;
  for (Index j = 1; j <= p.J; ++j) {
    const Vector dy = response(y.row(j).transpose(), r.output * dz);
    if (dy.size() > 0) result.output = std::max(result.output, rounding * dy.cwiseAbs().maxCoeff());
    dz = (r.decay * dz + r.input * dy).eval();
    double rho = norm(dz);
    const double sum = norm(Vector(x.row(j).transpose())) + norm(Vector(terms.row(j).transpose()));
    size = std::max(size, sum);
    if (j < p.J && (!same_set(y, j, j - 1) || !same_set(y, j, j + 1)))
      result.impulse = std::max(result.impulse, p.h * norm(Vector(driven.row(j).transpose())) / size);
    if (rho < 1e-14) {  // the perturbation is gone, what is left of it is rounding: another one starts
      dz = first / norm(first);
      log_growth = least = rho = 0;
    } else {
      dz /= rho;
      log_growth += std::log(rho);
      least = std::min(least, log_growth);
      most = std::max(most, log_growth - least);
    }
    rounding = rho * rounding + epsilon * sum;
    unit = rho * unit + 1;
    result.rounding = std::max(result.rounding, size > 0 ? rounding / size : 0);
    result.condition = std::max(result.condition, size > 0 ? unit / size : 0);
  }
  result.growth = std::exp(std::min(most, 700.0));
  return result;
}

double contact_frequency(const DiscreteProblem& p, const RowMatrix& y) {
  constexpr std::size_t most_sets = 16;
  constexpr double hardly_damped = 0.1;
  const DenseDynamics& d = *p.dense();
  const Matrix M = to_dense(p.scene.M);
  std::set<std::vector<Index>> sets;
  for (Index j = 0; j < y.rows() && sets.size() < most_sets; ++j) {
    std::vector<Index> S;
    for (Index i = 0; i < y.cols(); ++i)
      if (y(j, i) > 0) S.push_back(i);
    if (!S.empty()) sets.insert(S);
  }
  double frequency = 0;
  for (const std::vector<Index>& S : sets) {
    const Matrix response = M(S, S).partialPivLu().solve(Matrix(d.N(S, Eigen::all)));
    const Matrix closed = d.A - d.B(Eigen::all, S) * response;
    const ComplexVector eigenvalues = Eigen::EigenSolver<Matrix>(closed, false).eigenvalues();
    for (const Complex lambda : eigenvalues)
      if (std::abs(lambda.real()) < hardly_damped * std::abs(lambda.imag()))
        frequency = std::max(frequency, std::abs(lambda.imag()));
  }
  return frequency;
}

Divergence divergence(const RowMatrix& coarse, const RowMatrix& fine, const Vector& scale) {
  constexpr Index first_steps = 3;
  Divergence d;
  double size = 0;
  for (Index j = 1; j < coarse.rows(); ++j) {
    const double apart = (coarse.row(j) - fine.row(2 * j)).transpose().cwiseQuotient(scale).norm();
    if (!std::isfinite(apart)) return {INFINITY, INFINITY};
    size = std::max({size, coarse.row(j - 1).transpose().cwiseQuotient(scale).norm(),
                     coarse.row(j).transpose().cwiseQuotient(scale).norm()});
    d.pointwise = std::max(d.pointwise, size > 0 ? apart / size : 0);
    if (j <= first_steps) d.defect = std::max(d.defect, apart / double(j));
  }
  return d;
}

Change change_when_halved(const RowMatrix& coarse, const RowMatrix& fine, Index last) {
  std::vector<double> rows;
  double size = 0, sum = 0, whole = 0;
  for (Index j = 1; j <= last && coarse.cols() > 0; ++j) {
    const auto difference = (coarse.row(j) - fine.row(2 * j)).cwiseAbs();
    rows.push_back(difference.maxCoeff<Eigen::PropagateNaN>());
    if (std::isnan(rows.back())) return {INFINITY, INFINITY, INFINITY};
    size = std::max(size, fine.row(2 * j).cwiseAbs().maxCoeff());
    sum += difference.sum();
    whole += fine.row(2 * j).cwiseAbs().sum();
  }
  if (rows.empty() || size == 0) return {};
  std::sort(rows.begin(), rows.end());
  return {rows.back() / size, rows[(rows.size() - 1) * 95 / 100] / size, sum / whole};
}

RowMatrix running_integral(const RowMatrix& y, double h) {
  RowMatrix sum = RowMatrix::Zero(y.rows(), y.cols());
  for (Index j = 1; j < y.rows(); ++j) sum.row(j) = sum.row(j - 1) + h * y.row(j);
  return sum;
}

}  // namespace bromwich
