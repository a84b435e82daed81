#include "report/thinning.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace bromwich::report {
namespace {

double extreme(const Vector& y, const std::vector<Index>& rows, bool largest) {
  double found = largest ? -INFINITY : INFINITY;
  for (const Index j : rows)
    if (!std::isnan(y[j])) found = largest ? std::max(found, y[j]) : std::min(found, y[j]);
  return found;
}

TEST(Thinning, KeepsSpikesOfOneRow) {
  const Index rows = 100003;
  const Vector t = Vector::LinSpaced(rows, 0, 1);
  Vector y = (40 * t.array()).sin();
  y[70001] = 17;
  y[12345] = -9;
  const std::vector<Index> kept = thinned(t, y, 500);
  EXPECT_LE(kept.size(), 4u * 500 + 2);
  EXPECT_TRUE(std::is_sorted(kept.begin(), kept.end()));
  EXPECT_EQ(extreme(y, kept, true), 17);
  EXPECT_EQ(extreme(y, kept, false), -9);
  EXPECT_EQ(kept.front(), 0);
  EXPECT_EQ(kept.back(), rows - 1);
}

// The largest and the smallest value of every part of the time are those of all rows of the part.
TEST(Thinning, KeepsTheRangeOfEveryPart) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> step(0, 1), value(-1, 1);
  const Index rows = 5000, buckets = 40;
  Vector t(rows), y(rows);
  t[0] = 0;
  for (Index j = 1; j < rows; ++j) t[j] = t[j - 1] + step(random);
  for (double& v : y) v = value(random);
  const std::vector<Index> kept = thinned(t, y, buckets);
  for (Index b = 0; b < buckets; ++b) {
    const auto inside = [&](Index j) {
      return std::min<Index>(buckets - 1, Index(t[j] / t[rows - 1] * double(buckets))) == b;
    };
    std::vector<Index> all, few;
    for (Index j = 0; j < rows; ++j)
      if (inside(j)) all.push_back(j);
    std::copy_if(kept.begin(), kept.end(), std::back_inserter(few), inside);
    EXPECT_EQ(extreme(y, few, true), extreme(y, all, true)) << b;
    EXPECT_EQ(extreme(y, few, false), extreme(y, all, false)) << b;
  }
}

TEST(Thinning, OrbitsKeepExtremesOfBothCoordinates) {
  const Index rows = 60000;
  const Vector phase = Vector::LinSpaced(rows, 0, 400);
  Vector x = phase.array().cos(), y = phase.array().sin();
  x[31234] = 3, y[47777] = -5;
  const std::vector<Index> kept = thinned_orbit(x, y, 300);
  EXPECT_LE(kept.size(), 8u * 300 + 4);
  EXPECT_TRUE(std::is_sorted(kept.begin(), kept.end()));
  EXPECT_EQ(extreme(x, kept, true), 3);
  EXPECT_EQ(extreme(y, kept, false), -5);
  EXPECT_EQ(thinned_orbit(x.head(9), y.head(9), 4).size(), 9u);
}

TEST(Thinning, FewRowsStayAndGapsStayGaps) {
  const Vector few = Vector::LinSpaced(9, 0, 1);
  EXPECT_EQ(thinned(few, few, 4).size(), 9u);
  const Index rows = 4000;
  const Vector t = Vector::LinSpaced(rows, 0, 1);
  Vector y = t;
  y.segment(1503, 7).setConstant(NAN);
  const std::vector<Index> kept = thinned(t, y, 10);
  EXPECT_TRUE(std::binary_search(kept.begin(), kept.end(), 1502));
  EXPECT_TRUE(std::binary_search(kept.begin(), kept.end(), 1503));
  EXPECT_TRUE(std::binary_search(kept.begin(), kept.end(), 1510));
  EXPECT_TRUE(thinned(Vector(), Vector(), 10).empty());
  EXPECT_EQ(thinned(Vector::Zero(1), Vector::Zero(1), 10).size(), 1u);
}

TEST(Thinning, CellsHaveTheValueOfLargestModulus) {
  const Index rows = 1001;
  const Vector t = Vector::LinSpaced(rows, 0, 10);
  RowMatrix y = RowMatrix::Constant(rows, 7, 0.5);
  y(333, 4) = -6;  // one row of one component: part 33 of 100
  const RowMatrix cells = on_cells(t, y, 100, 7);
  EXPECT_EQ(cells.rows(), 7);
  EXPECT_EQ(cells.cols(), 100);
  EXPECT_EQ(cells(4, 33), -6);
  EXPECT_EQ((cells.array() == 0.5).count(), 699);
  const RowMatrix bands = on_cells(t, y, 100, 2);  // components 0..3 and 4..6
  EXPECT_EQ(bands(1, 33), -6);
  EXPECT_EQ((bands.array() == 0.5).count(), 199);
}

TEST(Thinning, CellsBetweenRowsHaveTheRowBefore) {
  const Vector t{{0, 5, 10}};
  RowMatrix y(3, 1);
  y << 1, 2, 3;
  const RowMatrix cells = on_cells(t, y, 10, 1);
  EXPECT_EQ(cells.row(0), (Eigen::RowVectorXd(10) << 1, 1, 1, 1, 1, 2, 2, 2, 2, 3).finished());
  RowMatrix gap = y;
  gap(1, 0) = NAN;
  EXPECT_EQ(on_cells(t, gap, 10, 1).array().isNaN().count(), 4);
}

}  // namespace
}  // namespace bromwich::report
