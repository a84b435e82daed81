#include "core/scan/solution_pieces.hpp"

#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double singular_rounding = 1e-11;  ///< as that of solutions of least norm (core/lcp/least_norm.cpp)
constexpr double usual_rounding = 16 * epsilon, gathered_rounding = 1e-11;
constexpr double vanishing_slack = 1e-12;  ///< of the terms of w_i

std::optional<Matrix> usual_inverse(const Matrix& W) {
  if (W.rows() == 0) return W;
  const Eigen::PartialPivLU<Matrix> lu(W);
  if (!(reciprocal_condition(lu) > singular_rounding)) return std::nullopt;
  return lu.inverse();
}

unsigned bits_of(const std::vector<Index>& S, Index first) {
  unsigned set = 0;
  for (const Index i : S) set |= 1u << (first + i);
  return set;
}

void scale_step(ChunkStep& s, Index first, const Equilibration& e) {
  for (Index k = 0; k < e.rows.size(); ++k) {
    const Index i = first + k;
    s.see.row(i) *= e.rows[k];
    if (s.of_q.cols() > 0) s.of_q.row(i) *= e.rows[k];
    s.q[i] *= e.rows[k];
    s.unit[i] = e.columns[k];
    s.drive.col(i) *= e.columns[k];
    if (s.shown.size() > 0) s.shown.col(i) *= e.columns[k];
  }
}

}  // namespace

SolutionPieces::SolutionPieces(PieceProblem problem, ChunkStep& step)
    : problem_(std::move(problem)),
      step_(step),
      scale_(equilibrate(problem_.W)),
      scaled_(scaled(problem_.W, scale_)),
      lcp_(problem_.W, problem_.lcp_class) {
  scale_step(step, problem_.first, scale_);
}

std::optional<ChunkPiece> SolutionPieces::at(const Vector& given) {
  failed_ = true;
  const Index n = scaled_.rows();
  const Vector q = given.segment(problem_.first, n);
  Vector y;
  if (!lcp_.solve(q.cwiseQuotient(scale_.rows), y).solved) return std::nullopt;
  y = y.cwiseQuotient(scale_.columns);
  const std::vector<Index> S = support_of(y);
  SlackTerms slack;
  slack.evaluate(scaled_, q, y);
  std::vector<Index> E;
  for (Index i = 0; i < n; ++i)
    if (y[i] > 0 || std::abs(slack.w[i]) <= vanishing_slack * slack.terms[i]) E.push_back(i);
  const auto inverse = usual_inverse(scaled_(S, S));
  Sets sets{bits_of(S, problem_.first), inverse ? 0 : bits_of(E, problem_.first), !inverse};
  auto known = std::find(known_.begin(), known_.end(), sets);
  if (known < known_.begin() + std::ptrdiff_t(settled_) && !sets.gathered) {
    sets.gathered = true;
    known = std::find(known_.begin(), known_.end(), sets);
  }
  failed_ = known < known_.begin() + std::ptrdiff_t(settled_);
  if (known != known_.end()) return std::nullopt;
  known_.push_back(sets);
  ChunkPiece piece = inverse ? regular_piece(S, *inverse) : singular_piece(S, E);
  piece.rounding = sets.gathered ? gathered_rounding : usual_rounding;
  differentiate(piece);
  return piece;
}

// (y_S, w_I) = (-W_SS^{-1} q_S, q_I - W_IS W_SS^{-1} q_S).
ChunkPiece SolutionPieces::regular_piece(const std::vector<Index>& S, const Matrix& inverse) const {
  const Index n = scaled_.rows(), u = step_.see.rows(), first = problem_.first;
  ChunkPiece piece;
  piece.active = bits_of(S, first);
  Matrix V = Matrix::Identity(n, n);
  if (!S.empty()) {
    V(Eigen::all, S) -= scaled_(Eigen::all, S) * inverse;
    V(S, Eigen::all).setZero();
    V(S, S) = -inverse;
  }
  piece.V = RowMatrix::Zero(u, u);
  piece.V.block(first, first, n, n) = V;
  return piece;
}

ChunkPiece SolutionPieces::singular_piece(const std::vector<Index>& S, const std::vector<Index>& E) const {
  const Index n = scaled_.rows(), u = step_.see.rows(), first = problem_.first;
  // Rows of comparable size; the norm is that of y itself.
  Eigen::CompleteOrthogonalDecomposition<Matrix> decomposition;
  decomposition.setThreshold(singular_rounding);
  const Vector rows = scale_.rows(E), columns = scale_.columns(S);
  decomposition.compute(rows.asDiagonal() * problem_.W(E, S));
  Matrix Z = Matrix::Zero(n, n);
  Z(S, E) = -(columns.cwiseInverse().asDiagonal() * Matrix(decomposition.pseudoInverse()));
  const Matrix w = Matrix::Identity(n, n) + scaled_ * Z;
  ChunkPiece piece;
  piece.active = bits_of(S, first);
  piece.equal = bits_of(E, first);
  Matrix V = w;
  V(E, Eigen::all).setZero();
  V(S, Eigen::all) = Z(S, Eigen::all);
  piece.V = RowMatrix::Zero(u, u);
  piece.V.block(first, first, n, n) = V;
  piece.K = RowMatrix::Zero(u, u);
  piece.K.block(first, first, n, n) = w;
  return piece;
}

void SolutionPieces::differentiate(ChunkPiece& piece) const {
  RowMatrix Z = piece.V;
  for (Index i = 0; i < Z.rows(); ++i)
    if (!(piece.active >> i & 1u)) Z.row(i).setZero();
  piece.P = step_.decay + step_.drive * Matrix(Z * step_.see);
}

}  // namespace bromwich
