#include "circuits/rows.hpp"

#include "circuits/block_order.hpp"

#include <Eigen/LU>
#include <Eigen/SparseLU>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace bromwich::circuits {

namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;
using Entries = std::vector<std::pair<Index, double>>;

constexpr Index most_dense = 64;  ///< larger blocks are eliminated as sparse matrices
constexpr double singular = 1e-13;

// Rows and columns scaled by powers of two, so that conductances of 1e-9 and 1e3 count alike in the search of pivots.
template <class Square>
void equilibrate(Square& P, Vector& rows, Vector& columns) {
  rows = Vector::Ones(P.rows()), columns = Vector::Ones(P.cols());
  const auto power = [](double largest) { return largest > 0 ? std::exp2(-std::round(std::log2(largest) / 2)) : 1.0; };
  for (int pass = 0; pass < 6; ++pass) {
    Vector of_rows = Vector::Zero(P.rows()), of_columns = Vector::Zero(P.cols());
    for (Index k = 0; k < P.outerSize(); ++k)
      for (typename Square::InnerIterator e(P, k); e; ++e)
        of_rows[e.row()] = std::max(of_rows[e.row()], std::abs(e.value()));
    of_rows = of_rows.unaryExpr(power);
    for (Index k = 0; k < P.outerSize(); ++k)
      for (typename Square::InnerIterator e(P, k); e; ++e) {
        e.valueRef() *= of_rows[e.row()];
        of_columns[e.col()] = std::max(of_columns[e.col()], std::abs(e.value()));
      }
    of_columns = of_columns.unaryExpr(power);
    for (Index k = 0; k < P.outerSize(); ++k)
      for (typename Square::InnerIterator e(P, k); e; ++e) e.valueRef() *= of_columns[e.col()];
    rows = rows.cwiseProduct(of_rows), columns = columns.cwiseProduct(of_columns);
  }
}

// P Z = Q of one block; empty where P is singular, with an unknown concerned.
Matrix eliminated(const SparseMatrix& P, const Matrix& Q, Index& concerned) {
  SparseMatrix scaled = P;
  Vector rows, columns;
  equilibrate(scaled, rows, columns);
  const auto refined = [&](const auto& lu) {
    const auto solve = [&](const Matrix& right) {
      return Matrix(columns.asDiagonal() * Matrix(lu.solve(Matrix(rows.asDiagonal() * right))));
    };
    Matrix Z = solve(Q);
    return Matrix(Z + solve(Q - P * Z));  // what cancels should cancel
  };
  if (P.rows() <= most_dense) {
    Eigen::FullPivLU<Matrix> lu{Matrix(scaled)};
    lu.setThreshold(singular * double(P.rows()));
    if (lu.isInvertible()) return refined(lu);
    lu.kernel().col(0).cwiseAbs().maxCoeff(&concerned);
    return {};
  }
  Eigen::SparseLU<SparseMatrix> lu(scaled);
  if (lu.info() == Eigen::Success) {
    const Matrix Z = refined(lu);
    const double off = (P * Z - Q).cwiseAbs().maxCoeff(), size = Q.cwiseAbs().maxCoeff();
    if (Z.allFinite() && off <= 1e-6 * size) return Z;
  }
  concerned = 0;
  return {};
}

class BlockSolver {
 public:
  BlockSolver(const Rows& P, const Rows& Q)
      : P_(P), Q_(Q), Z_(std::size_t(P.rows())), place_(std::size_t(P.rows()), -1) {
    sum_ = Vector::Zero(Q.cols());
    column_.assign(std::size_t(Q.cols()), -1);
  }

  BlockSolution run() {
    const BlockOrder order = block_order(P_);
    BlockSolution made;
    made.singular = order.unmatched;
    for (std::size_t k = 0; k < order.blocks.size() && made.singular < 0; ++k) solve(order.blocks[k], made.singular);
    if (made.singular >= 0) return made;
    Triplets all;
    for (std::size_t i = 0; i < Z_.size(); ++i)
      for (const auto& [signal, value] : Z_[i]) all.emplace_back(int(i), int(signal), value);
    made.Z = Rows(P_.cols(), Q_.cols());
    made.Z.setFromTriplets(all.begin(), all.end());
    return made;
  }

 private:
  void solve(const Block& block, Index& concerned) {
    const Index b = Index(block.size());
    for (Index k = 0; k < b; ++k) place_[std::size_t(block[std::size_t(k)].second)] = k;
    Triplets inner, right;
    std::vector<Index> used;
    for (Index k = 0; k < b; ++k) {
      Entries touched = right_side(block[std::size_t(k)].first, k, inner);
      for (const auto& [signal, value] : touched) {
        Index& column = column_[std::size_t(signal)];
        if (column < 0) column = Index(used.size()), used.push_back(signal);
        right.emplace_back(int(k), int(column), value);
      }
    }
    if (b == 1) {
      const double p = inner.empty() ? 0 : inner[0].value();
      if (p == 0) concerned = block[0].second;
      for (const auto& one : right)
        if (p != 0) Z_[std::size_t(block[0].second)].emplace_back(used[std::size_t(one.col())], one.value() / p);
    } else {
      SparseMatrix P(b, b);
      P.setFromTriplets(inner.begin(), inner.end());
      Matrix Q = Matrix::Zero(b, Index(used.size()));
      for (const auto& one : right) Q(one.row(), one.col()) += one.value();
      Index which = -1;
      const Matrix Z = eliminated(P, Q, which);
      if (which >= 0) concerned = block[std::size_t(which)].second;
      for (Index k = 0; k < Z.rows(); ++k)
        for (Index j = 0; j < Z.cols(); ++j)
          if (Z(k, j) != 0) Z_[std::size_t(block[std::size_t(k)].second)].emplace_back(used[std::size_t(j)], Z(k, j));
    }
    for (const Index signal : used) column_[std::size_t(signal)] = -1;
    for (const auto& [row, unknown] : block) place_[std::size_t(unknown)] = -1;
  }

  // Of a row: Q less what known unknowns give; its entries within the block go to `inner`.
  Entries right_side(Index row, Index k, Triplets& inner) {
    std::vector<Index> touched;
    const auto add = [&](Index signal, double value) {
      if (sum_[signal] == 0) touched.push_back(signal);
      sum_[signal] += value;
    };
    for (Rows::InnerIterator e(Q_, row); e; ++e) add(e.col(), e.value());
    for (Rows::InnerIterator e(P_, row); e; ++e) {
      if (const Index in_block = place_[std::size_t(e.col())]; in_block >= 0)
        inner.emplace_back(int(k), int(in_block), e.value());
      else
        for (const auto& [signal, value] : Z_[std::size_t(e.col())]) add(signal, -e.value() * value);
    }
    Entries entries;
    for (const Index signal : touched) {
      if (sum_[signal] != 0) entries.emplace_back(signal, sum_[signal]);
      sum_[signal] = 0;
    }
    return entries;
  }

  const Rows &P_, &Q_;
  std::vector<Entries> Z_;
  std::vector<Index> place_, column_;
  Vector sum_;
};

Rows stacked(const Rows& a, const Rows& b, Index rows, Index columns, Index down, Index right) {
  Triplets all;
  for (Index i = 0; i < a.rows(); ++i)
    for (Rows::InnerIterator e(a, i); e; ++e) all.emplace_back(int(i), int(e.col()), e.value());
  for (Index i = 0; i < b.rows(); ++i)
    for (Rows::InnerIterator e(b, i); e; ++e) all.emplace_back(int(i + down), int(e.col() + right), e.value());
  Rows made(rows, columns);
  made.setFromTriplets(all.begin(), all.end());
  return made;
}

}  // namespace

Rows columns(const Rows& m, Index first, Index count) {
  Triplets all;
  for (Index i = 0; i < m.rows(); ++i)
    for (Rows::InnerIterator e(m, i); e; ++e)
      if (e.col() >= first && e.col() < first + count) all.emplace_back(int(i), int(e.col() - first), e.value());
  Rows made(m.rows(), count);
  made.setFromTriplets(all.begin(), all.end());
  return made;
}

Rows beside(const Rows& a, const Rows& b) { return stacked(a, b, a.rows(), a.cols() + b.cols(), 0, a.cols()); }
Rows below(const Rows& a, const Rows& b) { return stacked(a, b, a.rows() + b.rows(), a.cols(), a.rows(), 0); }

BlockSolution solve_in_blocks(const Rows& P, const Rows& Q) { return BlockSolver(P, Q).run(); }

}  // namespace bromwich::circuits
