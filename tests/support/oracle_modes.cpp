#include "tests/support/oracle_modes.hpp"

#include <Eigen/Dense>

#include <cmath>

namespace bromwich::oracle {
namespace {

constexpr double singular = 1e-12;  ///< bound on a singular value, relative to the largest entry of its matrix

struct Ranges {
  Matrix inverse;  ///< pseudo-inverse
  Matrix U, V;     ///< left and right null space
};

Ranges ranges(const Matrix& M, double size) {
  const Eigen::JacobiSVD<Matrix> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector& values = svd.singularValues();
  Index rank = 0;
  while (rank < values.size() && values[rank] > singular * size) ++rank;
  const Matrix U = svd.matrixU(), V = svd.matrixV();
  return {V.leftCols(rank) * values.head(rank).cwiseInverse().asDiagonal() * U.leftCols(rank).transpose(),
          U.rightCols(M.rows() - rank), V.rightCols(M.cols() - rank)};
}

double largest_entry(const Matrix& A) { return A.size() == 0 ? 0 : A.cwiseAbs().maxCoeff(); }

/// Whether some y >= 0 has M y + r >= -noise and y ⊥ M y + r.
bool has_solution(const Matrix& M, const Vector& r, const Vector& noise) {
  const Index n = r.size();
  for (unsigned set = 0; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    Vector y = Vector::Zero(n);
    if (!S.empty()) y(S) = -ranges(M(S, S), largest_entry(M)).inverse * r(S);
    const Vector w = M * y + r;
    const Vector allowed = 2 * noise + M.cwiseAbs() * y.cwiseAbs() * 1e-10;
    bool good = (w + allowed).minCoeff() >= 0;
    for (const Index i : S) good = good && std::abs(w[i]) <= allowed[i] && y[i] >= -1e-9 * largest_entry(y);
    if (good) return true;
  }
  return false;
}

}  // namespace

std::optional<Mode> mode_of(const DenseScene& s, unsigned set) {
  const Index n = s.M.rows(), m = s.A.rows();
  const std::vector<Index> S = members(set, n);
  Mode mode{set,          Matrix::Zero(n, m), Matrix::Zero(n, m), Matrix::Zero(n, n), Matrix::Zero(n, n),
            Matrix(0, m), Matrix(0, n)};
  if (S.empty()) return mode;
  const Index k = Index(S.size());
  const Matrix NS = s.N(S, Eigen::all), BS = s.B(Eigen::all, S);
  const Ranges r = ranges(s.M(S, S), largest_entry(s.M));
  Matrix rows = Matrix::Zero(k, n);
  for (Index i = 0; i < k; ++i) rows(i, S[std::size_t(i)]) = 1;
  Matrix of_x = -r.inverse * NS, of_g = -r.inverse * rows;
  Matrix of_f = Matrix::Zero(k, m), of_slope = Matrix::Zero(k, n);
  if (r.U.cols() > 0) {
    mode.constraint_x = r.U.transpose() * NS;
    mode.constraint_g = r.U.transpose() * rows;
    const Matrix drive = mode.constraint_x * BS, along = drive * r.V;
    const double size = largest_entry(mode.constraint_x) * largest_entry(BS);
    const Eigen::JacobiSVD<Matrix> svd(along);
    if (!(svd.singularValues().minCoeff() > 1e-10 * size) || size == 0) return std::nullopt;
    const Matrix back = -r.V * along.inverse();
    const Matrix x_particular = of_x, g_particular = of_g;
    of_x += back * (mode.constraint_x * s.A + drive * x_particular);
    of_f += back * mode.constraint_x;
    of_g += back * drive * g_particular;
    of_slope += back * mode.constraint_g;
  }
  mode.y_of_x(S, Eigen::all) = of_x;
  mode.y_of_f(S, Eigen::all) = of_f;
  mode.y_of_g(S, Eigen::all) = of_g;
  mode.y_of_slope(S, Eigen::all) = of_slope;
  return mode;
}

std::vector<Jump> jumps_from(const DenseScene& s, const Vector& x, const Vector& g, const Vector& noise) {
  const Index n = s.M.rows();
  std::vector<Jump> found;
  for (unsigned set = 1; set < 1u << n; ++set)
    for (unsigned level = 0; level < 1u << n; ++level) {
      if (level & set) continue;  // rows of M p that vanish in addition to those of S: faces of the cone of p
      const std::vector<Index> S = members(set, n), R = members(set | level, n);
      const Matrix Z = ranges(s.M(R, S), std::max(largest_entry(s.M), 1e-300)).V;
      if (Z.cols() == 0) continue;
      const Matrix drive = s.B(Eigen::all, S) * Z, seen = Z.transpose() * s.N(S, Eigen::all) * drive;
      const Ranges r = ranges(seen, largest_entry(s.N) * largest_entry(s.B));
      if (r.U.cols() > 0) continue;
      Vector p = Vector::Zero(n);
      p(S) = Z * (-r.inverse * (Z.transpose() * (s.N(S, Eigen::all) * x + g(S))));
      const double size = largest_entry(p);
      if (size == 0 || p.minCoeff() < -1e-10 * size) continue;
      if ((s.M * p).minCoeff() < -1e-10 * largest_entry(s.M) * size) continue;
      const Vector after = x + s.B * p;
      if (has_solution(s.M, s.N * after + g, noise)) found.push_back({p, after});
    }
  return found;
}

}  // namespace bromwich::oracle
