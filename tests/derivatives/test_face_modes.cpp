// Sine modes of faces against products with the matrix of all modes.

#include "core/derivatives/face_modes.hpp"

#include "core/numerics/sine_basis.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace bromwich::face_modes_test {
namespace {

using reference::Random;

// n products of numbers below 1 in another order: n eps of the largest value, with a margin for the matrix itself.
double rounding(Index n) { return 8 * double(n) * std::numeric_limits<double>::epsilon(); }

class FaceModesOf : public testing::TestWithParam<std::vector<Index>> {};

TEST_P(FaceModesOf, AreProductsWithTheSineMatrix) {
  const FaceModes face(GetParam());
  const Matrix S = face_sine_matrix(GetParam());
  const Index n = S.rows();
  Random random(7);
  const RowMatrix values = random.matrix(5, n);
  const RowMatrix modes = face.of(values);
  EXPECT_LE((modes - values * S).cwiseAbs().maxCoeff(), rounding(n));
  EXPECT_LE((face.of(modes) - values).cwiseAbs().maxCoeff(), 2 * rounding(n));
}

TEST_P(FaceModesOf, OnSetsAreRowsAndColumnsOfIt) {
  const FaceModes face(GetParam());
  const Matrix S = face_sine_matrix(GetParam());
  const Index n = S.rows();
  Random random(8);
  for (const double share : {0.0, 0.3, 1.0}) {
    std::vector<Index> set;
    Vector on_set = Vector::Zero(n), modes, seen = Vector::Zero(n);
    for (Index i = 0; i < n; ++i)
      if (random.uniform(0, 1) < share) {
        set.push_back(i);
        on_set[i] = random.uniform();
      }
    face.of_set(set, on_set, modes);
    EXPECT_LE((modes - S * on_set).cwiseAbs().maxCoeff(), rounding(n));
    const Vector given = random.vector(n), expected = S * given;
    face.seen_on(set, given, seen);
    for (const Index i : set) EXPECT_NEAR(seen[i], expected[i], rounding(n));
  }
}

INSTANTIATE_TEST_SUITE_P(Extents, FaceModesOf,
                         testing::Values(std::vector<Index>{1}, std::vector<Index>{2}, std::vector<Index>{3},
                                         std::vector<Index>{8}, std::vector<Index>{39}, std::vector<Index>{64},
                                         std::vector<Index>{127}, std::vector<Index>{3, 4}));

}  // namespace
}  // namespace bromwich::face_modes_test
