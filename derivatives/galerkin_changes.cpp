#include "derivatives/galerkin_changes.hpp"

#include "core/numerics/matrix_phi.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich {

namespace {

double sum_of_products(const RowMatrix& a, const RowMatrix& b) {
  return a.size() > 0 && b.size() > 0 ? a.cwiseProduct(b).sum() : 0;
}

// (2 a + b, a + 2 b)/3, the moments of a line from a to b.
Vector moments_of_line(const Vector& a, const Vector& b) {
  Vector both(a.size() + b.size());
  both << (2 * a + b) / 3, (a + 2 * b) / 3;
  return both;
}

std::vector<GridPart> parts_of(const GalerkinProblem& p) {
  std::vector<GridPart> parts;
  for (const GalerkinRun& run : p.runs) parts.push_back({p.t[run.first + run.count], run.count});
  return parts;
}

Index run_at(const GalerkinProblem& p, Index k) {
  Index run = 0;
  while (run + 1 < Index(p.runs.size()) && p.runs[std::size_t(run + 1)].first <= k) ++run;
  return run;
}

// c_0, c_1, c_2 of the parabola Σ c_j s^j/j! through the values of phi at the Gauss points of an interval, as
// core/galerkin/sources.cpp takes f. Rows of three tables, N x k each.
std::array<RowMatrix, 3> parabolas(const Scene& scene, const GalerkinProblem& p) {
  const double d = std::sqrt(0.15);
  const Eigen::Vector3d at(0.5 - d, 0.5, 0.5 + d);
  Eigen::Matrix3d powers;
  for (int i = 0; i < 3; ++i) powers.row(i) << 1, at[i], at[i] * at[i] / 2;
  const Eigen::Matrix3d of_values = powers.inverse();
  std::array<RowMatrix, 3> c;
  c.fill(RowMatrix::Zero(p.N, scene.sources()));
  Vector value(scene.sources());
  for (Index k = 0; k < p.N; ++k)
    for (int i = 0; i < 3; ++i) {
      value.setZero();
      scene.f(p.t[k] + at[i] * (p.t[k + 1] - p.t[k]), value);
      for (int j = 0; j < 3; ++j) c[std::size_t(j)].row(k) += of_values(j, i) * value.transpose();
    }
  return c;
}

// Σ_j of the derivative of phi_j(hA) with respect to A, transposed, in the direction of its gradient bar_j.
Matrix gradient_by_A(const Matrix& A, double h, const std::vector<Matrix>& bar) {
  const Index m = A.rows();
  Matrix sum = Matrix::Zero(m, m);
  for (std::size_t j = 0; j < bar.size(); ++j) {
    const double size = bar[j].cwiseAbs().maxCoeff();
    if (!(size > 0)) continue;
    const double unit = std::max(A.cwiseAbs().maxCoeff(), 1e-3 / h) / size;
    Matrix both = Matrix::Zero(2 * m, 2 * m);
    both.topLeftCorner(m, m) = both.bottomRightCorner(m, m) = A.transpose();
    both.topRightCorner(m, m) = unit * bar[j];
    sum += matrix_phis(h * both, 5)[j].topRightCorner(m, m) / unit;
  }
  return sum;
}

}  // namespace

double product(const GalerkinChange& a, const GalerkinChange& b) {
  return sum_of_products(a.F, b.F) + sum_of_products(a.q, b.q) + sum_of_products(a.direct, b.direct) +
         (a.b.size() > 0 && b.b.size() > 0 ? a.b.dot(b.b) : 0);
}

void add_matrix_changes(const GalerkinState& s, const Matrix& dA, const Matrix& dB, const Matrix& dN, const Matrix& dF,
                        GalerkinChange& to) {
  if (dA.size() == 0 && dB.size() == 0 && dN.size() == 0 && dF.size() == 0) return;
  const DenseDynamics& d = *s.scene.dynamics->small_state();
  const Index m = d.A.rows(), n = d.B.cols(), k = s.scene.sources();
  const Matrix F = source_matrix(s.scene, d);
  const double size = dA.size() > 0 ? dA.cwiseAbs().maxCoeff() : 0;
  const double unit = size > 0 ? std::max(d.A.cwiseAbs().maxCoeff(), 1e-3 / s.problem.t[1]) / size : 1;
  const auto scaled = [unit](const Matrix& given, Index rows, Index cols) {
    return given.size() > 0 ? Matrix(unit * given) : Matrix::Zero(rows, cols);
  };
  DenseDynamics large{Matrix::Zero(2 * m, 2 * m), Matrix(2 * m, n), Matrix(n, 2 * m)};
  large.A.topLeftCorner(m, m) = large.A.bottomRightCorner(m, m) = d.A;
  large.A.topRightCorner(m, m) = scaled(dA, m, m);
  large.B << scaled(dB, m, n), d.B;
  large.N << d.N, scaled(dN, n, m);
  Scene scene = s.scene;
  scene.dynamics = large;
  scene.M = Matrix(Matrix::Zero(n, n));
  scene.g = {};
  scene.boundary.reset();
  scene.x0 = Vector::Zero(2 * m);
  if (scene.f) {
    Matrix entry(2 * m, k);
    entry << scaled(dF, m, k), F;
    scene.F = entry.sparseView();
    scene.f_entry = SourceEntry::through_F;
  }
  const GalerkinProblem p = galerkin_problem(scene, parts_of(s.problem));
  RowMatrix of_F = p.forcing.leftCols(m), of_q = p.q;
  for (const GalerkinRun& run : p.runs) {
    const auto x = s.x.middleRows(run.first, run.count), z = s.z.middleRows(run.first, run.count);
    of_F.middleRows(run.first, run.count) +=
        x * run.step.E.topRightCorner(m, m).transpose() + z * run.step.H.topRows(m).transpose();
    of_q.middleRows(run.first, run.count) += x * run.step.C.rightCols(m).transpose() + z * run.step.D.transpose();
  }
  to.F += of_F / unit;
  to.q += of_q / unit;
  if (dN.size() > 0) to.direct += s.x * dN.transpose();
}

MatrixGradients matrix_gradients(const GalerkinState& s, const GalerkinChange& of) {
  const DenseDynamics& d = *s.scene.dynamics->small_state();
  const Index m = d.A.rows(), n = d.B.cols(), k = s.scene.sources();
  const Matrix F = s.scene.f ? source_matrix(s.scene, d) : Matrix::Zero(m, k), &N = d.N, &B = d.B;
  MatrixGradients bar{Matrix::Zero(m, m), Matrix::Zero(m, n), Matrix(of.direct.transpose() * s.x), Matrix::Zero(m, k)};
  const std::array<RowMatrix, 3> c = s.scene.f ? parabolas(s.scene, s.problem) : std::array<RowMatrix, 3>();
  for (const GalerkinRun& run : s.problem.runs) {
    const double h = s.problem.t[run.first + 1] - s.problem.t[run.first];
    const std::vector<Matrix> G = matrix_phis(h * d.A, 5);
    const auto rows = [&](const RowMatrix& table) { return table.middleRows(run.first, run.count); };
    const auto x = rows(s.x), z = rows(s.z), lambda = rows(of.F), q = rows(of.q);
    std::vector<Matrix> of_G(6, Matrix::Zero(m, m));
    of_G[0] = lambda.transpose() * x;
    // H = h [(G_1 - G_2) B, G_2 B].
    const Matrix H = lambda.transpose() * z, Ha = H.leftCols(n), Hb = H.rightCols(n);
    of_G[1] += h * Ha * B.transpose();
    of_G[2] += h * (Hb - Ha) * B.transpose();
    bar.B += h * ((G[1] - G[2]).transpose() * Ha + G[2].transpose() * Hb);
    // C = 2 [N G_2; N (G_1 - G_2)].
    const Matrix C = q.transpose() * x, Ca = C.topRows(n), Cb = C.bottomRows(n);
    of_G[2] += 2 * N.transpose() * (Ca - Cb);
    of_G[1] += 2 * N.transpose() * Cb;
    bar.N += 2 * (Ca * G[2].transpose() + Cb * (G[1] - G[2]).transpose());
    // D = 2h [N (G_3 - G_4) B, N G_4 B; N (G_2 - 2 G_3 + G_4) B, N (G_3 - G_4) B] + ...
    const Matrix D = q.transpose() * z, diagonal = D.topLeftCorner(n, n) + D.bottomRightCorner(n, n),
                 upper = D.topRightCorner(n, n), lower = D.bottomLeftCorner(n, n);
    const std::array<Matrix, 3> by{lower, diagonal - 2 * lower, upper + lower - diagonal};
    for (std::size_t j = 0; j < 3; ++j) {
      of_G[j + 2] += 2 * h * N.transpose() * by[j] * B.transpose();
      bar.N += 2 * h * by[j] * B.transpose() * G[j + 2].transpose();
      bar.B += 2 * h * G[j + 2].transpose() * N.transpose() * by[j];
    }
    for (std::size_t j = 0; j < 3 && s.scene.f; ++j) {
      // F has h G_{j+1} F c_j; q has 2h N G_{j+3} F c_j and 2h N (G_{j+2} - G_{j+3}) F c_j.
      const Matrix state = lambda.transpose() * rows(c[j]), top = q.leftCols(n).transpose() * rows(c[j]),
                   bottom = q.rightCols(n).transpose() * rows(c[j]);
      of_G[j + 1] += h * state * F.transpose();
      bar.F += h * G[j + 1].transpose() * state;
      const Matrix third = top - bottom;
      of_G[j + 3] += 2 * h * N.transpose() * third * F.transpose();
      of_G[j + 2] += 2 * h * N.transpose() * bottom * F.transpose();
      bar.F += 2 * h * (G[j + 3].transpose() * N.transpose() * third + G[j + 2].transpose() * N.transpose() * bottom);
      bar.N += 2 * h * (third * F.transpose() * G[j + 3].transpose() + bottom * F.transpose() * G[j + 2].transpose());
    }
    bar.A += gradient_by_A(d.A, h, of_G);
  }
  return bar;
}

std::vector<GalerkinEntry> galerkin_entries(const GalerkinProblem& p, SharedDynamics& shared) {
  const Matrix& N = shared.dense().N;
  const Index n = N.rows(), m = N.cols();
  std::vector<GalerkinEntry> entries;
  for (const GalerkinRun& run : p.runs) {
    const double h = p.t[run.first + 1] - p.t[run.first];
    const std::vector<Matrix>& G = *shared.phis(h);
    const Matrix diagonal = 2 * h * N * (G[3] - G[4]);
    GalerkinEntry entry{{h * (G[1] - G[2]), h * G[2]}, {Matrix(2 * n, m), Matrix(2 * n, m)}};
    entry.q_of_f[0] << diagonal, 2 * h * N * (G[2] - 2 * G[3] + G[4]);
    entry.q_of_f[1] << 2 * h * N * G[4], diagonal;
    entries.push_back(std::move(entry));
  }
  return entries;
}

void add_source_changes(const GalerkinState& s, const std::vector<GalerkinEntry>& entries, const RowMatrix& f,
                        const RowMatrix& g, const Matrix& M, GalerkinChange& to) {
  const Index n = s.y.cols();
  for (Index k = 0; k < s.problem.N; ++k) {
    const GalerkinEntry& entry = entries[std::size_t(run_at(s.problem, k))];
    auto q = to.q.row(k);
    for (Index end = 0; end < 2 && f.size() > 0; ++end) {
      q += (entry.q_of_f[end] * f.row(k + end).transpose()).transpose();
      to.F.row(k) += (entry.F[end] * f.row(k + end).transpose()).transpose();
    }
    if (g.size() > 0) q += moments_of_line(g.row(k).transpose(), g.row(k + 1).transpose()).transpose();
    if (M.size() > 0)
      q += moments_of_line(M * s.z.row(k).head(n).transpose(), M * s.z.row(k).tail(n).transpose()).transpose();
  }
  if (g.size() > 0) to.direct += g;
  if (M.size() > 0) to.direct += s.y * M.transpose();
}

SourceGradients source_gradients(const GalerkinState& s, const std::vector<GalerkinEntry>& entries,
                                 const GalerkinChange& of) {
  const Index n = s.y.cols();
  SourceGradients bar{RowMatrix::Zero(s.problem.N + 1, s.x.cols()), of.direct, of.direct.transpose() * s.y};
  for (Index k = 0; k < s.problem.N; ++k) {
    const GalerkinEntry& entry = entries[std::size_t(run_at(s.problem, k))];
    const Vector lambda = of.F.row(k).transpose(), q = of.q.row(k).transpose();
    for (Index end = 0; end < 2; ++end)
      bar.f.row(k + end) += (entry.F[end].transpose() * lambda + entry.q_of_f[end].transpose() * q).transpose();
    const Vector of_ends = moments_of_line(q.head(n), q.tail(n));
    bar.g.row(k) += of_ends.head(n).transpose();
    bar.g.row(k + 1) += of_ends.tail(n).transpose();
    bar.M += of_ends.head(n) * s.z.row(k).head(n) + of_ends.tail(n) * s.z.row(k).tail(n);
  }
  return bar;
}

}  // namespace bromwich
