#include "core/galerkin/uniqueness.hpp"

#include "core/base/error.hpp"
#include "core/galerkin/discretisation.hpp"
#include "core/numerics/orthogonal_factor.hpp"
#include "core/numerics/two_point.hpp"

#include <Eigen/Dense>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_lanczos_steps = 250;
constexpr double eigenvalue_tolerance = 1e-7;  ///< residual of the Ritz pair, relative to the largest eigenvalue

Scene weighted(const Scene& scene, double lambda) {
  Scene shifted = scene;
  DenseDynamics d = to_dense(scene.dynamics);
  d.A.diagonal().array() -= lambda;
  shifted.dynamics = std::move(d);
  shifted.f = shifted.g = {};
  shifted.f_entry = SourceEntry::state;
  shifted.F = {};
  if (shifted.boundary) shifted.boundary->ET *= std::exp(lambda * scene.T);
  return shifted;
}

// The symmetric part in coefficients for which the norm of y is Euclidean: z = R^{-1} v, (2/h) ∫ |y|^2 = |R z|^2.
class SymmetricPart {
 public:
  explicit SymmetricPart(const Scene& scene, Index N) : p_(galerkin_problem(scene, N)), n_(p_.unknowns() / 2) {
    p_.boundary.b.setZero();
    const Index m = p_.states();
    adjoint_ = {Matrix(m, m), Matrix(m, m), Vector::Zero(m)};
    Matrix rows(2 * m, m);  // (lambda_0, lambda_N) lies in its range
    rows << p_.boundary.E0.transpose(), -p_.boundary.ET.transpose();
    const Matrix normal = orthogonal_factor(rows.householderQr().householderQ()).rightCols(m).transpose();
    adjoint_.ET = normal.leftCols(m);  // time runs backwards: lambda_N comes first
    adjoint_.E0 = normal.rightCols(m);
    E_transposed_ = p_.first_step().E.transpose();
  }

  Index size() const { return p_.N * 2 * n_; }

  Vector operator()(const Vector& v) const {
    const RowMatrix z = changed(Eigen::Map<const RowMatrix>(v.data(), p_.N, 2 * n_), false);
    const RowMatrix w = changed(0.5 * (galerkin_slack(p_, z, galerkin_states(p_, z)) + transposed(z)), true);
    return Eigen::Map<const Vector>(w.data(), w.size());
  }

 private:
  // D^T u_k + H^T lambda_k, lambda_{k-1} = E^T lambda_k + C^T u_k.
  RowMatrix transposed(const RowMatrix& u) const {
    const std::vector<const Matrix*> P(std::size_t(p_.N), &E_transposed_);
    const RowMatrix reversed = (u * p_.first_step().C).colwise().reverse();
    const RowMatrix lambda = solve_two_point(P, reversed, adjoint_, epsilon);
    if (lambda.rows() == 0)
      throw Error("boundary", "E0 + ET e^{TA} is singular", "give conditions that determine the states");
    return u * p_.first_step().D + RowMatrix(lambda.topRows(p_.N).colwise().reverse()) * p_.first_step().H;
  }

  // R^{-1} or R^{-T} on each row, R^T R = 1/3 [2, 1; 1, 2].
  RowMatrix changed(const RowMatrix& v, bool transpose) const {
    const double a = std::sqrt(2. / 3), b = 1 / (3 * a), c = std::sqrt(2. / 3 - b * b);  // R = [a, b; 0, c]
    RowMatrix z(v.rows(), v.cols());
    if (transpose) {
      z.leftCols(n_) = v.leftCols(n_) / a;
      z.rightCols(n_) = (v.rightCols(n_) - b * z.leftCols(n_)) / c;
    } else {
      z.rightCols(n_) = v.rightCols(n_) / c;
      z.leftCols(n_) = (v.leftCols(n_) - b * z.rightCols(n_)) / a;
    }
    return z;
  }

  GalerkinProblem p_;
  Index n_;
  BoundaryCondition adjoint_;
  Matrix E_transposed_;
};

// Some vector with a part in every direction.
Vector lanczos_start(Index size) {
  Vector v(size);
  for (Index i = 0; i < size; ++i) v[i] = std::cos(1.7 * double(i) + 0.3 * double(i * i % 97));
  return v.normalized();
}

}  // namespace

double smallest_symmetric_eigenvalue(const Scene& scene, Index steps, double lambda) {
  const SymmetricPart S(weighted(scene, lambda), steps);
  const Index most = std::min(S.size(), most_lanczos_steps);
  Matrix V(S.size(), most);
  Vector alpha(most), beta(most);
  V.col(0) = lanczos_start(S.size());
  double smallest = 0;
  for (Index j = 0; j < most; ++j) {
    Vector r = S(V.col(j));
    alpha[j] = r.dot(V.col(j));
    for (int twice = 0; twice < 2; ++twice) r -= V.leftCols(j + 1) * (V.leftCols(j + 1).transpose() * r);
    beta[j] = r.norm();
    const bool last = j + 1 == most || beta[j] == 0;
    if (last || j % 5 == 4) {
      Eigen::SelfAdjointEigenSolver<Matrix> ritz;
      ritz.computeFromTridiagonal(alpha.head(j + 1), beta.head(j));
      smallest = ritz.eigenvalues()[0];
      const double size = ritz.eigenvalues().cwiseAbs().maxCoeff();
      if (last || beta[j] * std::abs(ritz.eigenvectors()(j, 0)) <= eigenvalue_tolerance * size) return smallest;
    }
    V.col(j + 1) = r / beta[j];
  }
  return smallest;
}

}  // namespace bromwich
