#include "core/galerkin_discretisation.hpp"

#include "core/error.hpp"
#include "core/phi.hpp"
#include "core/two_point.hpp"

#include <Eigen/Dense>

#include <array>
#include <cmath>

namespace bromwich {

namespace {

// Gauss points on [0,1], their weights, and the parabola through values there: Σ_i values_i parabola(i, j) s^j / j!.
struct GaussParabola {
  Eigen::Vector3d points, weights;
  Eigen::Matrix3d parabola;
};

GaussParabola gauss_parabola() {
  const double d = std::sqrt(0.15);
  GaussParabola gauss{{0.5 - d, 0.5, 0.5 + d}, {5. / 18, 8. / 18, 5. / 18}, {}};
  Eigen::Matrix3d powers;  // row i: 1, s_i, s_i^2 / 2
  for (int i = 0; i < 3; ++i) powers.row(i) << 1, gauss.points[i], gauss.points[i] * gauss.points[i] / 2;
  gauss.parabola = powers.inverse().transpose();
  return gauss;
}

// What the value of f at each Gauss point adds to F_k (m x k) and to q_k (2n x k), f = entry phi.
struct SourceResponse {
  std::array<Matrix, 3> state, moments;
};

SourceResponse source_response(const std::vector<Matrix>& G, const Matrix& N, const Matrix& entry, double h,
                               const GaussParabola& gauss) {
  const Index m = entry.rows(), k = entry.cols(), n = N.rows();
  SourceResponse response;
  for (int i = 0; i < 3; ++i) {
    Matrix state = Matrix::Zero(m, k), moments = Matrix::Zero(2 * n, k);
    for (int j = 0; j < 3; ++j) {  // s^j/j! responds with s^{j+1} phi_{j+1}(s hA), whose moments are these
      const auto& phi = [&](int order) -> const Matrix& { return G[std::size_t(j + order)]; };
      const double c = h * gauss.parabola(i, j);
      state += c * phi(1) * entry;
      moments.topRows(n) += 2 * c * N * phi(3) * entry;
      moments.bottomRows(n) += 2 * c * N * (phi(2) - phi(3)) * entry;
    }
    response.state[std::size_t(i)] = state;
    response.moments[std::size_t(i)] = moments;
  }
  return response;
}

GalerkinStep step_from(const std::vector<Matrix>& G, const DenseDynamics& d, const Matrix& M, double h) {
  const Index m = d.A.rows(), n = M.rows();
  GalerkinStep step{G[0], Matrix(m, 2 * n), Matrix(2 * n, m), Matrix(2 * n, 2 * n), Matrix(2 * n, 2 * n)};
  const Matrix first = G[1] - G[2], diagonal = d.N * (G[3] - G[4]) * d.B;
  step.H << h * first * d.B, h * G[2] * d.B;
  step.C << 2 * d.N * G[2], 2 * d.N * first;
  step.M << 2 * M, M, M, 2 * M;
  step.M /= 3;
  step.D << diagonal, d.N * G[4] * d.B, d.N * (G[2] - 2 * G[3] + G[4]) * d.B, diagonal;
  step.D = (step.M + 2 * h * step.D).eval();
  return step;
}

}  // namespace

BoundaryCondition boundary_of(const Scene& scene) {
  const Index m = scene.states();
  return scene.boundary.value_or(BoundaryCondition{Matrix::Identity(m, m), Matrix::Zero(m, m), scene.x0});
}

Matrix source_entry(const Scene& scene, const DenseDynamics& d) {
  if (scene.f_entry == SourceEntry::through_B) return d.B;
  if (scene.f_entry == SourceEntry::through_F) return Matrix(scene.F);
  return Matrix::Identity(d.A.rows(), d.A.rows());
}

GalerkinStep galerkin_step(const DenseDynamics& d, const Matrix& M, double h) {
  return step_from(matrix_phis(h * d.A, 4), d, M, h);
}

GalerkinProblem galerkin_problem(const Scene& scene, Index N) {
  const DenseDynamics d = to_dense(scene.dynamics);
  const Index m = d.A.rows(), n = d.B.cols();
  GalerkinProblem p;
  p.N = N;
  p.h = scene.T / double(N);
  const std::vector<Matrix> G = matrix_phis(p.h * d.A, 5);
  p.step = step_from(G, d, to_dense(scene.M), p.h);
  p.boundary = boundary_of(scene);
  p.initial_value = !scene.boundary;
  p.forcing = RowMatrix::Zero(N, m);
  p.q = RowMatrix::Zero(N, 2 * n);
  const GaussParabola gauss = gauss_parabola();
  const SourceResponse response = source_response(G, d.N, source_entry(scene, d), p.h, gauss);
  Vector f(scene.sources()), g(n);
  for (Index k = 0; k < N; ++k)
    for (int i = 0; i < 3; ++i) {
      const double s = gauss.points[i], t = (double(k) + s) * p.h;
      if (scene.f) {
        scene.f(t, f);
        p.forcing.row(k).transpose() += response.state[std::size_t(i)] * f;
        p.q.row(k).transpose() += response.moments[std::size_t(i)] * f;
      }
      if (scene.g) {
        scene.g(t, g);
        p.q.row(k).head(n) += 2 * gauss.weights[i] * (1 - s) * g.transpose();
        p.q.row(k).tail(n) += 2 * gauss.weights[i] * s * g.transpose();
      }
    }
  return p;
}

RowMatrix galerkin_states(const GalerkinProblem& p, const RowMatrix& z) {
  const RowMatrix input = p.forcing + z * p.step.H.transpose();
  if (!p.initial_value) {
    const std::vector<const Matrix*> P(std::size_t(p.N), &p.step.E);
    RowMatrix x = solve_two_point(P, input, p.boundary, epsilon);
    if (x.rows() == 0)
      throw Error("boundary", "E0 + ET e^{TA} is singular", "give conditions that determine the states");
    return x;
  }
  RowMatrix x(p.N + 1, p.states());
  x.row(0) = p.boundary.b.transpose();
  for (Index k = 0; k < p.N; ++k) x.row(k + 1).noalias() = x.row(k) * p.step.E.transpose() + input.row(k);
  return x;
}

RowMatrix galerkin_slack(const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x) {
  RowMatrix w = p.q;
  w.noalias() += z * p.step.D.transpose();
  w.noalias() += x.topRows(p.N) * p.step.C.transpose();
  return w;
}

RowMatrix apply_galerkin(const GalerkinProblem& p, const RowMatrix& z) {
  GalerkinProblem linear = p;
  linear.forcing.setZero();
  linear.q.setZero();
  linear.boundary.b.setZero();
  return galerkin_slack(linear, z, galerkin_states(linear, z));
}

}  // namespace bromwich
