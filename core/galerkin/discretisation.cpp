#include "core/galerkin/discretisation.hpp"

#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/galerkin/sources.hpp"
#include "core/numerics/phi.hpp"
#include "core/numerics/two_point.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

namespace {

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

GalerkinStep galerkin_step(SharedDynamics& shared, const Matrix& M, double h) {
  return step_from(*shared.phis(h), shared.dense(), M, h);
}

GalerkinProblem galerkin_problem(const Scene& scene, const std::vector<GridPart>& parts) {
  SharedDynamics own(scene.dynamics);
  return galerkin_problem(scene, parts, own);
}

GalerkinProblem galerkin_problem(const Scene& scene, const std::vector<GridPart>& parts, SharedDynamics& shared) {
  const DenseDynamics& d = shared.dense();
  const Matrix M = to_dense(scene.M), entry = source_matrix(scene, d);
  const Index m = d.A.rows(), n = d.B.cols();
  GalerkinProblem p;
  for (const GridPart& part : parts) p.N += part.intervals;
  p.t = Vector::Zero(p.N + 1);
  p.boundary = boundary_of(scene);
  p.initial_value = !scene.boundary;
  p.forcing = RowMatrix::Zero(p.N, m);
  p.q = RowMatrix::Zero(p.N, 2 * n);
  GalerkinSources sources(scene, d, entry, scene.breakpoints);
  Polling poll;
  Index first = 0;
  double begin = 0;
  for (const GridPart& part : parts) {
    const double h = (part.end - begin) / double(part.intervals);
    p.runs.push_back({first, part.intervals, galerkin_step(shared, M, h)});
    for (Index j = 0; j < part.intervals; ++j) {
      poll();
      const Index k = first + j;
      p.t[k + 1] = j + 1 == part.intervals ? part.end : begin + double(j + 1) * h;
      sources.add(begin + double(j) * h, h, p.forcing.row(k).transpose(), p.q.row(k).transpose());
    }
    first += part.intervals;
    begin = part.end;
  }
  p.divided = sources.divided();
  return p;
}

GalerkinProblem galerkin_problem(const Scene& scene, Index N) {
  return galerkin_problem(scene, std::vector<GridPart>{{scene.T, N}});
}

GalerkinProblem coarser_problem(const Scene& scene, const GalerkinProblem& fine) {
  SharedDynamics own(scene.dynamics);
  return coarser_problem(scene, fine, own);
}

GalerkinProblem coarser_problem(const Scene& scene, const GalerkinProblem& fine, SharedDynamics& shared) {
  const GalerkinStep& step = fine.first_step();
  const Index N = fine.N / 2, n = fine.unknowns() / 2;
  GalerkinProblem p;
  p.N = N;
  p.t = fine.t(Eigen::seqN(0, N + 1, 2));
  p.runs = {{0, N, galerkin_step(shared, to_dense(scene.M), p.t[1])}};
  p.boundary = fine.boundary;
  p.initial_value = fine.initial_value;
  const auto first = Eigen::seqN(0, N, 2), second = Eigen::seqN(1, N, 2);
  const RowMatrix F = fine.forcing(first, Eigen::all), early = fine.q(first, Eigen::all),
                  late = fine.q(second, Eigen::all) + F * step.C.transpose();
  p.forcing = fine.forcing(second, Eigen::all) + F * step.E.transpose();
  const RowMatrix common = early.rightCols(n) / 4 + late.leftCols(n) / 4;
  p.q.resize(N, 2 * n);
  p.q.leftCols(n) = early.leftCols(n) / 2 + common;
  p.q.rightCols(n) = late.rightCols(n) / 2 + common;
  return p;
}

RowMatrix galerkin_states(const GalerkinProblem& p, const RowMatrix& z) {
  RowMatrix input = p.forcing;
  for (const GalerkinRun& run : p.runs)
    input.middleRows(run.first, run.count).noalias() += z.middleRows(run.first, run.count) * run.step.H.transpose();
  if (!p.initial_value) {
    std::vector<const Matrix*> P;
    for (const GalerkinRun& run : p.runs) P.insert(P.end(), std::size_t(run.count), &run.step.E);
    RowMatrix x = solve_two_point(P, input, p.boundary, epsilon);
    if (x.rows() == 0)
      throw Error("boundary", "E0 + ET e^{TA} is singular", "give conditions that determine the states");
    return x;
  }
  RowMatrix x(p.N + 1, p.states());
  x.row(0) = p.boundary.b.transpose();
  for (const GalerkinRun& run : p.runs)
    for (Index k = run.first; k < run.first + run.count; ++k)
      x.row(k + 1).noalias() = x.row(k) * run.step.E.transpose() + input.row(k);
  return x;
}

namespace {

// q + C x, and D z.
RowMatrix galerkin_response(const GalerkinProblem& p, const RowMatrix* z, const RowMatrix& x) {
  RowMatrix w = p.q;
  for (const GalerkinRun& run : p.runs) {
    auto rows = w.middleRows(run.first, run.count);
    if (z) rows.noalias() += z->middleRows(run.first, run.count) * run.step.D.transpose();
    rows.noalias() += x.middleRows(run.first, run.count) * run.step.C.transpose();
  }
  return w;
}

}  // namespace

RowMatrix galerkin_slack(const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x) {
  return galerkin_response(p, &z, x);
}

RowMatrix galerkin_known(const GalerkinProblem& p, const RowMatrix& x) { return galerkin_response(p, nullptr, x); }

double natural_residual(const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x,
                        const std::vector<Index>& free_rows, const NaturalUnits* units) {
  const Index n = p.unknowns() / 2;
  RowMatrix known = galerkin_known(p, x), w = galerkin_slack(p, z, x), y = z;
  for (Index i = 0; i < z.cols() && units; ++i) {
    const double unit_y = times_ten_to(units->y[std::size_t(i % n)], 1),
                 unit_w = times_ten_to(units->w[std::size_t(i % n)], 1);
    y.col(i) *= unit_y;
    w.col(i) *= unit_w;
    known.col(i) *= unit_w;
  }
  RowMatrix map = y.cwiseMin(w);
  for (const Index i : free_rows)
    for (const Index at : {i, n + i}) map.col(at) = w.col(at);
  return map.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / std::max(1.0, known.cwiseAbs().maxCoeff());
}

RowMatrix apply_galerkin(const GalerkinProblem& p, const RowMatrix& z) {
  GalerkinProblem linear = p;
  linear.forcing.setZero();
  linear.q.setZero();
  linear.boundary.b.setZero();
  return galerkin_slack(linear, z, galerkin_states(linear, z));
}

}  // namespace bromwich
