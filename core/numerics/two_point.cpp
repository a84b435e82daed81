#include "core/numerics/two_point.hpp"

#include "core/numerics/equilibration.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <functional>
#include <unordered_map>

namespace bromwich {

namespace {

// [V U] = L Q with orthonormal rows Q: V x_i + U x_j = r becomes Q (x_i; x_j) = L^{-1} r. Rows that are scaled alone
// become more and more alike in the course of thousands of steps.
Segment with_orthonormal_rows(const Segment& s) {
  const Index m = s.r.size();
  Matrix rows(2 * m, m);
  rows << s.V.transpose(), s.U.transpose();
  const Eigen::HouseholderQR<Matrix> qr(rows);
  const Matrix Q = qr.householderQ() * Matrix::Identity(2 * m, m);
  const auto L = qr.matrixQR().topRows(m).template triangularView<Eigen::Upper>().transpose();
  return {Q.topRows(m).transpose(), Q.bottomRows(m).transpose(), L.solve(s.r)};
}

}  // namespace

Segment step_segment(const Matrix& P, const Vector& p) {
  return with_orthonormal_rows({-P, Matrix::Identity(P.rows(), P.rows()), p});
}

Segment joined(const Segment& first, const Segment& second, InnerState* inner) {
  const Index m = first.r.size();
  Matrix shared(2 * m, m), rest = Matrix::Zero(2 * m, 2 * m + 1);
  shared << first.U, second.V;
  rest.topLeftCorner(m, m) = first.V;
  rest.block(m, m, m, m) = second.U;
  rest.col(2 * m) << first.r, second.r;
  const Eigen::HouseholderQR<Matrix> qr(shared);
  rest.applyOnTheLeft(qr.householderQ().adjoint());
  if (inner) {
    const Matrix x = qr.matrixQR().topRows(m).template triangularView<Eigen::Upper>().solve(Matrix(rest.topRows(m)));
    *inner = {-x.leftCols(m), -x.middleCols(m, m), x.col(2 * m)};
  }
  return with_orthonormal_rows({rest.bottomLeftCorner(m, m), rest.block(m, m, m, m), rest.bottomRightCorner(m, 1)});
}

Segment repeated(const Matrix& P, const Vector& p, Index N) {
  Segment power = step_segment(P, p);
  Segment all;
  bool any = false;
  for (;; N /= 2) {
    if (N % 2 == 1) {
      all = any ? joined(power, all) : power;
      any = true;
    }
    if (N <= 1) return all;
    power = joined(power, power);
  }
}

EndStates solve_ends(const Segment& all, const BoundaryCondition& boundary) {
  const Index m = all.r.size();
  Matrix system(2 * m, 2 * m);
  system << all.V, all.U, boundary.E0, boundary.ET;
  if (!system.allFinite()) return {Vector::Constant(m, NAN), Vector::Constant(m, NAN), 0};
  const Equilibration scale = equilibrate(system);
  const Matrix balanced = scale.rows.asDiagonal() * system * scale.columns.asDiagonal();
  const Eigen::PartialPivLU<Matrix> lu(balanced);
  Vector right(2 * m);
  right << all.r, boundary.b;
  const Vector ends = scale.columns.cwiseProduct(lu.solve(scale.rows.cwiseProduct(right)));
  return {ends.head(m), ends.tail(m), reciprocal_condition(lu)};
}

void condense_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, Index first, Index last, Matrix* Phi,
                    Eigen::Ref<Vector> phi) {
  const Index m = p.cols();
  Vector next(m);
  phi.setZero();
  for (Index k = first; k < last; ++k) {
    next = p.row(k).transpose();
    next.noalias() += P[std::size_t(k)]->lazyProduct(phi);
    phi = next;
  }
  if (!Phi) return;
  Matrix next_Phi(m, m);
  Phi->setIdentity(m, m);
  for (Index k = first; k < last; ++k) {
    next_Phi.noalias() = P[std::size_t(k)]->lazyProduct(*Phi);
    Phi->swap(next_Phi);
  }
}

void expand_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, Index first, Index last, Index block,
                  RowMatrix& x, BlockEnds& ends) {
  Vector state = x.row(first).transpose(), error = epsilon * state.cwiseAbs(), next(state.size()), reach(state.size());
  ends.largest.row(block) = state.cwiseAbs().transpose();
  for (Index k = first; k < last; ++k) {
    const Matrix& step = *P[std::size_t(k)];
    reach = error + epsilon * state.cwiseAbs();
    error.noalias() = step.cwiseAbs().lazyProduct(reach);
    next = p.row(k).transpose();
    error += epsilon * next.cwiseAbs();
    next.noalias() += step.lazyProduct(state);
    state.swap(next);
    ends.largest.row(block) = ends.largest.row(block).cwiseMax(state.cwiseAbs().transpose());
    if (k + 1 < last) x.row(k + 1) = state.transpose();
  }
  ends.state.row(block) = state.transpose();
  ends.error.row(block) = error.transpose();
}

bool blocks_meet(const RowMatrix& starts, const BlockEnds& ends, Index length) {
  const double accepted_rounding = 1e-12 + 8 * epsilon * double(length);
  const Index blocks = ends.state.rows();
  const Eigen::RowVectorXd accepted = accepted_rounding * ends.largest.colwise().maxCoeff();
  for (Index b = 0; b < blocks; ++b)
    for (Index i = 0; i < ends.state.cols(); ++i)
      if (!(std::abs(ends.state(b, i) - starts(b + 1, i)) + ends.error(b, i) <= accepted[i])) return false;
  return true;
}

RowMatrix solve_two_point_in_blocks(const std::vector<const Matrix*>& P, const RowMatrix& p,
                                    const BoundaryCondition& boundary, double least_condition, Index length) {
  const Index N = p.rows(), m = p.cols(), blocks = count_blocks(N, length);
  const RowMatrix none(0, m);
  std::vector<Matrix> Phi(static_cast<std::size_t>(blocks));
  std::vector<const Matrix*> pointers(Phi.size(), nullptr);
  std::unordered_map<const Matrix*, const Matrix*> powers;  // of one map, `length` times
  RowMatrix phi(blocks, m);
  for (Index b = 0; b < blocks; ++b) {
    const Index first = b * length, last = std::min(N, first + length);
    const Matrix* const map = P[std::size_t(first)];
    const auto begin = P.begin() + first, end = P.begin() + last;
    const bool power = last - first == length && std::all_of(begin, end, [map](const Matrix* at) { return at == map; });
    const Matrix*& known = power ? powers[map] : pointers[std::size_t(b)];
    condense_steps(P, p, first, last, known ? nullptr : &Phi[std::size_t(b)], phi.row(b).transpose());
    if (!known) known = &Phi[std::size_t(b)];
    pointers[std::size_t(b)] = known;
    if (!(known->cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= 1 / epsilon) || !phi.row(b).allFinite()) return none;
  }
  const RowMatrix starts =
      solve_two_point_by_segments(pointers, phi, boundary, std::max(least_condition, least_block_condition));
  if (starts.rows() == 0) return none;
  RowMatrix x(N + 1, m);
  BlockEnds ends(blocks, m);
  for (Index b = 0; b < blocks; ++b) {
    x.row(b * length) = starts.row(b);
    expand_steps(P, p, b * length, std::min(N, (b + 1) * length), b, x, ends);
  }
  x.row(N) = starts.row(blocks);
  return blocks_meet(starts, ends, length) ? x : none;
}

namespace {

// GMRES from 0: x with A x = b to 1e-14 of b, or empty. No restarts: V has all directions.
Vector gmres(const std::function<Vector(const Vector&)>& A, const Vector& b) {
  constexpr Index most_products = 100;
  constexpr double gmres_tolerance = 1e-14;
  const double size = b.norm();
  if (size == 0) return b;
  const Index most = std::min(most_products, b.size());
  Matrix V(b.size(), most + 1), H = Matrix::Zero(most + 1, most);
  V.col(0) = b / size;
  for (Index j = 0; j < most; ++j) {
    Vector w = A(V.col(j));
    for (int twice = 0; twice < 2; ++twice) {
      const Vector along = V.leftCols(j + 1).transpose() * w;
      H.col(j).head(j + 1) += along;
      w -= V.leftCols(j + 1) * along;
    }
    H(j + 1, j) = w.norm();
    if (!std::isfinite(H(j + 1, j))) return Vector();
    const Vector right = size * Vector::Unit(j + 2, 0);
    const Matrix small = H.topLeftCorner(j + 2, j + 1);
    const Vector c = small.householderQr().solve(right);
    const bool ended = (small * c - right).norm() <= gmres_tolerance * size || H(j + 1, j) == 0;
    if (ended || j + 1 == b.size()) return V.leftCols(j + 1) * c;
    V.col(j + 1) = w / H(j + 1, j);
  }
  return Vector();
}

}  // namespace

RowMatrix solve_two_point_krylov(const std::vector<const Matrix*>& P, const RowMatrix& p,
                                 const BoundaryCondition& boundary) {
  constexpr double accepted_boundary = 1e-11;
  const Index N = p.rows(), m = p.cols();
  const auto at_end = [&](Vector x, bool driven) {
    for (Index k = 0; k < N; ++k) {
      x = (*P[std::size_t(k)] * x).eval();
      if (driven) x += p.row(k).transpose();
    }
    return x;
  };
  const Vector right = boundary.b - boundary.ET * at_end(Vector::Zero(m), true);
  const Vector x0 =
      gmres([&](const Vector& v) -> Vector { return boundary.E0 * v + boundary.ET * at_end(v, false); }, right);
  if (x0.size() == 0) return RowMatrix(0, m);
  RowMatrix x(N + 1, m);
  x.row(0) = x0.transpose();
  for (Index k = 0; k < N; ++k)
    x.row(k + 1).transpose() = *P[std::size_t(k)] * x.row(k).transpose() + p.row(k).transpose();
  const Vector first = x.row(0).transpose(), last = x.row(N).transpose();
  const Vector apart = boundary.E0 * first + boundary.ET * last - boundary.b;
  const Vector terms = boundary.E0.cwiseAbs() * first.cwiseAbs() + boundary.ET.cwiseAbs() * last.cwiseAbs();
  if (!(apart.cwiseAbs().maxCoeff() <= accepted_boundary * terms.maxCoeff())) return RowMatrix(0, m);
  return x;
}

namespace {

// Powers of 2 in which the states have comparable sizes: D^{-1} |P| D with rows and columns of equal size, for the sum
// of all maps (B. N. Parlett and C. Reinsch, Numer. Math. 13, 1969). Two states count that act on each other. One that
// only receives says nothing of its unit, and what rounding leaves of the other direction neither.
Vector units_of(const std::vector<const Matrix*>& maps, Index m) {
  constexpr int most_sweeps = 20;
  constexpr double above_rounding = 1e-14;
  Matrix size = Matrix::Zero(m, m);
  for (const Matrix* map : maps) size += map->cwiseAbs();
  const Vector own = size.diagonal();
  const Matrix both_ways = size.cwiseProduct(size.transpose()), rounding = above_rounding * own * own.transpose();
  size = (both_ways.array() > rounding.array()).select(size, 0);
  size.diagonal().setZero();
  Vector D = Vector::Ones(m);
  if (!size.allFinite()) return D;
  bool changed = true;
  for (int sweep = 0; changed && sweep < most_sweeps; ++sweep) {
    changed = false;
    for (Index i = 0; i < m; ++i) {
      const double column = size.col(i).sum(), row = size.row(i).sum();
      if (!(column > 0 && row > 0)) continue;
      const double unit = std::exp2(std::round(std::log2(row / column) / 2));
      if (unit == 1 || !std::isfinite(unit) || unit == 0) continue;
      size.col(i) *= unit;
      size.row(i) /= unit;
      D[i] *= unit;
      changed = true;
    }
  }
  return D;
}

// Whether x_k = P_k x_{k-1} + p_k holds, relative to the largest of its terms and of all states, which have units of
// comparable size here: elimination mixes them, so that a state that is zero has the rounding of the others.
bool holds_in_steps(const std::vector<const Matrix*>& P, const RowMatrix& p, const RowMatrix& x) {
  constexpr double accepted = 1e-9;
  const double largest = x.cwiseAbs().maxCoeff();
  Vector apart(p.cols());
  for (Index k = 0; k < p.rows(); ++k) {
    const Matrix& step = *P[std::size_t(k)];
    apart = x.row(k + 1).transpose() - p.row(k).transpose();
    apart.noalias() -= step.lazyProduct(x.row(k).transpose());
    const double terms =
        (step.cwiseAbs() * x.row(k).cwiseAbs().transpose()).maxCoeff() + p.row(k).cwiseAbs().maxCoeff();
    if (!(apart.cwiseAbs().maxCoeff() <= accepted * (largest + terms))) return false;
  }
  return true;
}

RowMatrix solve_in_units(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition& boundary,
                         double least_condition) {
  RowMatrix x;
  if (p.cols() >= fewest_krylov_states) {
    x = solve_two_point_krylov(P, p, boundary);
    if (x.rows() > 0) return x;
  } else {
    for (const Index length : block_lengths) {
      x = solve_two_point_in_blocks(P, p, boundary, least_condition, length);
      if (x.rows() > 0) return x;
    }
  }
  x = solve_two_point_by_segments(P, p, boundary, least_condition);
  return x.rows() > 0 && holds_in_steps(P, p, x) ? x : RowMatrix(0, p.cols());
}

}  // namespace

RowMatrix solve_two_point(const std::vector<const Matrix*>& P, const RowMatrix& p, const BoundaryCondition& boundary,
                          double least_condition) {
  std::vector<const Matrix*> maps = P;
  std::sort(maps.begin(), maps.end());
  maps.erase(std::unique(maps.begin(), maps.end()), maps.end());
  const Vector D = units_of(maps, p.cols());
  if (D.isOnes(0)) return solve_in_units(P, p, boundary, least_condition);
  std::vector<Matrix> scaled;
  scaled.reserve(maps.size());
  std::unordered_map<const Matrix*, const Matrix*> scaled_of;
  for (const Matrix* map : maps) {
    scaled.push_back(D.cwiseInverse().asDiagonal() * *map * D.asDiagonal());
    scaled_of[map] = &scaled.back();
  }
  std::vector<const Matrix*> steps(P.size());
  std::transform(P.begin(), P.end(), steps.begin(), [&](const Matrix* map) { return scaled_of[map]; });
  const RowMatrix x =
      solve_in_units(steps, p * D.cwiseInverse().asDiagonal(),
                     {boundary.E0 * D.asDiagonal(), boundary.ET * D.asDiagonal(), boundary.b}, least_condition);
  return x * D.asDiagonal();
}

RowMatrix solve_two_point_by_segments(const std::vector<const Matrix*>& P, const RowMatrix& p,
                                      const BoundaryCondition& boundary, double least_condition) {
  const Index N = p.rows(), m = p.cols();
  std::vector<InnerState> inner(std::size_t(N - 1));
  Segment all = step_segment(*P[0], p.row(0));
  for (Index k = 1; k < N; ++k)
    all = joined(all, step_segment(*P[std::size_t(k)], p.row(k)), &inner[std::size_t(k - 1)]);
  const EndStates ends = solve_ends(all, boundary);
  if (!(ends.reciprocal_condition >= least_condition)) return RowMatrix(0, m);
  RowMatrix x(N + 1, m);
  x.row(0) = ends.first.transpose();
  x.row(N) = ends.last.transpose();
  Vector next = ends.last;
  for (Index k = N - 1; k > 0; --k) {
    const InnerState& s = inner[std::size_t(k - 1)];
    next = (s.a + s.L * ends.first + s.R * next).eval();
    x.row(k) = next.transpose();
  }
  return x;
}

}  // namespace bromwich
