// Sine modes of faces against products with the matrix of all modes.

#include "derivatives/face_modes.hpp"

#include "core/dynamics/second_difference.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <vector>

namespace bromwich::face_modes_test {
namespace {

using reference::Random;

// n products of numbers below 1 in another order: n eps of the largest value, with a margin for the matrix itself.
double rounding(Index n) { return 8 * double(n) * std::numeric_limits<double>::epsilon(); }

// Of a line with these ends; a null matrix stands for sine vectors.
std::shared_ptr<const Matrix> modes_with(Index n, double first, double last) {
  return std::make_shared<const Matrix>(SecondDifference{n, 1. / double(n), 1, first, last}.modes());
}

std::vector<FaceBasis> bases() {
  std::vector<FaceBasis> all;
  for (const std::vector<Index>& extents : {std::vector<Index>{1}, {2}, {3}, {8}, {39}, {64}, {127}, {3, 4}})
    all.emplace_back(extents);
  for (const Index n : {1, 5, 64, 131}) all.emplace_back(std::vector<LineBasis>{{n, modes_with(n, 1, 0.3)}});
  all.emplace_back(std::vector<LineBasis>{{3, modes_with(3, 1, 1)}, {4}});
  return all;
}

class FaceModesOf : public testing::TestWithParam<FaceBasis> {};

TEST_P(FaceModesOf, AreProductsWithTheMatrix) {
  const FaceModes face(GetParam());
  const Matrix V = GetParam().matrix();
  const Index n = V.rows();
  Random random(7);
  const RowMatrix values = random.matrix(5, n);
  const RowMatrix modes = face.to_modes(values);
  EXPECT_LE((modes - values * V).cwiseAbs().maxCoeff(), rounding(n));
  EXPECT_LE((face.to_points(values) - values * V.transpose()).cwiseAbs().maxCoeff(), rounding(n));
  EXPECT_LE((face.to_points(modes) - values).cwiseAbs().maxCoeff(), 2 * rounding(n));
}

TEST_P(FaceModesOf, OnSetsAreRowsAndColumnsOfIt) {
  const FaceModes face(GetParam());
  const Matrix V = GetParam().matrix();
  const Index n = V.rows();
  Random random(8);
  for (const double share : {0.0, 0.3, 1.0}) {
    std::vector<Index> set;
    Vector on_set = Vector::Zero(n), modes(face.width()), seen = Vector::Zero(n), given = Vector::Zero(face.width());
    for (Index i = 0; i < n; ++i)
      if (random.uniform(0, 1) < share) {
        set.push_back(i);
        on_set[i] = random.uniform();
      }
    face.of_set(set, on_set, modes.data());
    EXPECT_LE((modes.head(n) - V.transpose() * on_set).cwiseAbs().maxCoeff(), rounding(n));
    EXPECT_EQ(modes.tail(face.width() - n).norm(), 0);
    given.head(n) = random.vector(n);
    const Vector expected = V * given.head(n);
    face.seen_on(set, given.data(), seen);
    for (const Index i : set) EXPECT_NEAR(seen[i], expected[i], rounding(n));
  }
}

INSTANTIATE_TEST_SUITE_P(Bases, FaceModesOf, testing::ValuesIn(bases()));

}  // namespace
}  // namespace bromwich::face_modes_test
