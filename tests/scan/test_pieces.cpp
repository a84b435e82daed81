// Affine pieces of the solutions of steps, and sources by few numbers.

#include "core/scan/solution_pieces.hpp"
#include "core/scan/source_numbers.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

constexpr double few_roundings = 1e-14;  // of a few operations with numbers of size 1

// A step whose state is q: see = I and drive = I.
struct PieceStep {
  PieceStep(const Matrix& W, LcpClass c) {
    const Index n = W.rows();
    step.see = step.decay = step.drive = RowMatrix::Identity(n, n);
    step.q = Vector::Zero(n);
    step.unit = Vector::Ones(n);
    pieces = std::make_unique<SolutionPieces>(PieceProblem{W, c, 0}, step);
  }
  // In scaled units.
  Vector scaled(const Vector& q) const { return step.see * q; }
  // y of the active set.
  Vector y(const ChunkPiece& piece, const Vector& q) const {
    Vector v = piece.V * scaled(q);
    for (Index i = 0; i < v.size(); ++i) v[i] = piece.active >> i & 1u ? v[i] * step.unit[i] : 0;
    return v;
  }

  ChunkStep step;
  std::unique_ptr<SolutionPieces> pieces;
};

TEST(Pieces, OfARegularActiveSet) {
  const Matrix W{{2e6, 1e3}, {1e3, 2}};
  PieceStep s(W, LcpClass::P);
  const Vector q{{-3e6, -1}};
  // y_1 alone: 1.5, w_2 = -1 + 1e3 * 1.5 > 0.
  const auto piece = s.pieces->at(s.scaled(q));
  ASSERT_TRUE(piece);
  EXPECT_EQ(piece->active, 1u);
  EXPECT_EQ(piece->equal, 0u);
  EXPECT_NEAR(s.y(*piece, q)[0], 1.5, few_roundings);
  const Vector other{{-5e6, 4}};
  EXPECT_NEAR(s.y(*piece, other)[0], 2.5, few_roundings);
  // P = decay + drive Z see: dx+/dx = I + Z.
  EXPECT_NEAR(piece->P(0, 0), 1 - 1 / 2e6, few_roundings);
  EXPECT_NEAR(piece->P(1, 1), 1, few_roundings);
  // A known piece is not given again.
  EXPECT_FALSE(s.pieces->at(s.scaled(other)));
  EXPECT_FALSE(s.pieces->failed());
  // Where a later march finds q outside it nevertheless, it is given for gathered rounding, once.
  s.pieces->settle();
  const auto again = s.pieces->at(s.scaled(other));
  ASSERT_TRUE(again);
  EXPECT_GT(again->rounding, piece->rounding);
  s.pieces->settle();
  EXPECT_FALSE(s.pieces->at(s.scaled(other)));
  EXPECT_TRUE(s.pieces->failed());
}

TEST(Pieces, OfLeastNormHaveEquations) {
  PieceStep s(Matrix{{1, 1}, {1, 1}}, LcpClass::PSD);
  const Vector q{{-2, -2}};
  const auto piece = s.pieces->at(s.scaled(q));
  ASSERT_TRUE(piece);
  EXPECT_EQ(piece->active, 3u);
  EXPECT_EQ(piece->equal, 3u);
  // y_1 + y_2 = 2, of least norm.
  EXPECT_NEAR((s.y(*piece, q) - Vector{{1, 1}}).norm(), 0, few_roundings);
  EXPECT_NEAR((piece->K * s.scaled(q)).norm(), 0, few_roundings);
  // Where q_1 != q_2 only the larger shortage is met with equality: w_2 = q_2 - q_1.
  EXPECT_GT((piece->K * s.scaled(Vector{{-2, -1.9}})).norm(), 0.01);
}

TEST(Pieces, OfASkewProblemUseItsEquations) {
  // W_11 = 0, and y_1 = -q_2 follows from w_2 = 0.
  PieceStep s(Matrix{{0, -1}, {1, 0}}, LcpClass::PSD);
  const Vector q{{0, -3}};
  const auto piece = s.pieces->at(s.scaled(q));
  ASSERT_TRUE(piece);
  EXPECT_NEAR((s.y(*piece, q) - Vector{{3, 0}}).norm(), 0, few_roundings);
}

TEST(Pieces, WithoutASolutionThereIsNone) {
  PieceStep s(Matrix{{0, 0}, {0, 1}}, LcpClass::PSD);
  EXPECT_FALSE(s.pieces->at(s.scaled(Vector{{-1, 0}})));
  EXPECT_TRUE(s.pieces->failed());
}

TEST(SourceNumbers, AreFewAndMakeTheTable) {
  const Index J = 50;
  RowMatrix table(J + 1, 5);
  for (Index j = 0; j <= J; ++j) {
    const double s = std::sin(0.3 * double(j)), c = std::cos(0.2 * double(j));
    table.row(j) << 3, s, -2 * s + 1, c, 0;
  }
  table.row(0).setConstant(99);  // no step ends there
  const SourceNumbers found = source_numbers(table);
  EXPECT_EQ(found.numbers.cols(), 2);
  const Matrix again = (found.numbers * found.of.transpose()).rowwise() + found.constant.transpose();
  EXPECT_LE((again - table).bottomRows(J).cwiseAbs().maxCoeff(), 1e-15 * 8);  // a few roundings of numbers up to 3
}

}  // namespace
}  // namespace bromwich
