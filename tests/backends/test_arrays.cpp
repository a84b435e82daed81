// Contract of Backend: operations on whole arrays of the hierarchy of time grids.

#include "core/kernel/recurrence.hpp"
#include "core/seam/shared_memory.hpp"
#include "tests/support/backends.hpp"

#include <cmath>
#include <limits>

namespace bromwich {
namespace {

using reference::Random;

class BackendArrays : public BackendTest {};

INSTANTIATE_TEST_SUITE_P(Contract, BackendArrays, testing::ValuesIn(backend_cases()), backend_case_name);

/// Rows with and without padding on a device, short arrays and arrays of many blocks.
const std::vector<std::pair<Index, Index>> shapes{{1, 1}, {1, 5}, {2, 16}, {3, 15}, {7, 33}, {64, 64}, {500, 127}};

TEST_P(BackendArrays, InjectionTakesEveryRthRow) {
  for (const auto& [steps, n] : shapes)
    for (const Index ratio : {1, 2, 3}) {
      const RowMatrix fine = Random(1).matrix(ratio * steps + 1, n);
      const auto from = device(fine), to = device(Random(2).matrix(steps + 1, n));
      backend->inject(*from, *to);
      EXPECT_EQ(host(*to), RowMatrix(fine(Eigen::seqN(0, steps + 1, ratio), Eigen::all))) << steps << ' ' << n;
      EXPECT_EQ(host(*from), fine) << "the fine array is not touched";
    }
}

TEST_P(BackendArrays, AnUploadLeavesTheRowsItDoesNotBring) {
  for (const auto& [steps, n] : shapes) {
    const RowMatrix before = Random(16).matrix(steps + 1, n), rows = Random(17).matrix(1, n);
    const auto a = device(before);
    backend->upload(rows, *a);
    RowMatrix expected = before;
    expected.row(0) = rows;
    EXPECT_EQ(host(*a), expected) << steps << ' ' << n;
  }
}

TEST_P(BackendArrays, AProductOfShapesIsWrittenOut) {
  for (const auto& [steps, n] : shapes)
    for (const Index terms : {1, 2, 5}) {
      const RowMatrix amplitudes = Random(20).matrix(steps + 1, terms), V = Random(21).matrix(n, terms);
      const auto a = device(Random(22).matrix(steps + 2, n));
      const RowMatrix last = host(*a).row(steps + 1);
      backend->upload_product(amplitudes, V, *a);
      RowMatrix expected(steps + 2, n);
      expected << amplitudes * V.transpose(), last;
      EXPECT_LE(distance(host(*a), expected), 16 * epsilon) << steps << ' ' << n;
      EXPECT_EQ(host(*a).row(steps + 1), last) << "a row that the product does not have";
    }
}

TEST_P(BackendArrays, OtherProgramsMayUseTheirMemory) {
  auto* memory = dynamic_cast<SharedMemory*>(backend.get());
  ASSERT_NE(memory, nullptr);
  for (const Index cols : {1, 2, 15, 16, 17, 63}) {
    const RowMatrix values = RowMatrix::Random(9, cols);
    const auto from = device(values), to = backend->array(9, cols);
    const std::shared_ptr<double> numbers = memory->numbers(values.size());
    memory->write(*from, numbers.get());
    RowMatrix copied(9, cols);
    memory->to_host(numbers.get(), sizeof(double) * std::size_t(values.size()), copied.data());
    EXPECT_EQ(copied, values);
    memory->read(numbers.get(), *to);
    EXPECT_EQ(host(*to), values);
  }
}

TEST_P(BackendArrays, AProductWithMIsAdded) {
  auto& memory = dynamic_cast<SharedMemory&>(*backend);
  for (const Index n : {1, 2, 15, 16, 17, 63}) {
    const Tridiagonal three{Vector::Random(n), Vector::Random(n), Vector::Random(n)};
    for (const LcpMatrix& M : {LcpMatrix(three), LcpMatrix(Matrix(Matrix::Random(n, n)))}) {
      const RowMatrix y = RowMatrix::Random(9, n), q = RowMatrix::Random(9, n);
      const auto arrays = std::pair(device(y), device(q));
      memory.add_product(M, *arrays.first, *arrays.second);
      // n + 1 terms below 1
      EXPECT_LE((host(*arrays.second) - q - y * to_dense(M).transpose()).cwiseAbs().maxCoeff(),
                2 * double(n + 1) * double(n + 1) * epsilon);
    }
  }
}

TEST_P(BackendArrays, RangesMayAskForRanges) {
  for (const Index count : {0, 1, 7, 8, 9, 100}) {
    std::vector<int> visits(std::size_t(3 * count), 0);
    backend->each_range(count, 8, [&](Index first, Index last) {
      backend->each_range(3 * (last - first), 5, [&](Index begin, Index end) {
        for (Index i = begin; i < end; ++i) ++visits[std::size_t(3 * first + i)];
      });
    });
    EXPECT_EQ(visits, std::vector<int>(std::size_t(3 * count), 1));
  }
}

TEST_P(BackendArrays, RangesMayBeAskedForDuringADownload) {
  const RowMatrix values = Random(23).matrix(4200, 512);
  const auto a = device(values);
  std::vector<int> visits(100, 0);
  RowMatrix fetched;
  backend->download_during(*a, fetched, [&] {
    backend->each_range(100, 7, [&](Index first, Index last) {
      for (Index i = first; i < last; ++i) ++visits[std::size_t(i)];
    });
  });
  EXPECT_EQ(fetched, values);
  EXPECT_EQ(visits, std::vector<int>(100, 1));
}

// Both arrays are larger than the ring of the transfer.
TEST_P(BackendArrays, ADownloadMayComeWithinAnother) {
  const RowMatrix first = Random(18).matrix(4200, 512), second = Random(19).matrix(4200, 512);
  const auto a = device(first), b = device(second);
  RowMatrix outer, inner;
  backend->download_during(*a, outer, [&] { backend->download(*b, inner); });
  EXPECT_EQ(outer, first);
  EXPECT_EQ(inner, second);
}

TEST_P(BackendArrays, InterpolationIsLinearBetweenRows) {
  for (const auto& [steps, n] : shapes)
    for (const Index ratio : {1, 2, 3, 8})
      for (const bool corrected : {false, true}) {
        const RowMatrix coarse = Random(3).matrix(steps + 1, n), old = Random(4).matrix(steps + 1, n),
                        fine = Random(5).matrix(ratio * steps + 1, n);
        const auto c = device(coarse), o = device(old), f = device(fine);
        backend->interpolate(*c, corrected ? o.get() : nullptr, *f);
        const RowMatrix added = corrected ? RowMatrix(coarse - old) : coarse;
        RowMatrix expected = fine;
        for (Index j = 0; j <= ratio * steps; ++j) {
          const double right = double(j % ratio) / double(ratio);
          expected.row(j) += (1 - right) * added.row(j / ratio) + right * added.row((j + ratio - 1) / ratio);
        }
        // Five sums of numbers below 2, in any order.
        EXPECT_LE(distance(host(*f), expected), 10 * epsilon) << steps << ' ' << n << ' ' << ratio;
      }
}

TEST_P(BackendArrays, ACoarseProblemTakesEveryRthRow) {
  for (const auto& [steps, n] : shapes)
    for (const Index ratio : {2, 8}) {
      const Index rows = ratio * steps + 1;
      const RowMatrix r = Random(12).matrix(rows, n), v = Random(13).matrix(rows, n), y = Random(14).matrix(rows, n),
                      coarse_v = Random(15).matrix(steps + 1, n);
      const auto coarse_r = backend->array(steps + 1, n), coarse_y = backend->array(steps + 1, n),
                 old = backend->array(steps + 1, n);
      backend->restrict_problem(*device(r), *device(v), *device(y), *device(coarse_v), *coarse_r, *coarse_y, *old);
      const auto taken = Eigen::seqN(0, steps + 1, ratio);
      EXPECT_LE(distance(host(*coarse_r), RowMatrix(r + v)(taken, Eigen::all) - coarse_v), 4 * epsilon) << steps;
      EXPECT_EQ(host(*coarse_y), RowMatrix(y(taken, Eigen::all))) << steps << ' ' << n;
      EXPECT_EQ(host(*old), host(*coarse_y)) << steps << ' ' << n;
    }
}

TEST_P(BackendArrays, SumsMayOverwriteWhatTheyAdd) {
  for (const auto& [steps, n] : shapes) {
    const RowMatrix first = Random(6).matrix(steps + 1, n), second = Random(7).matrix(steps + 1, n);
    const RowMatrix expected = first - 3 * second;
    const auto a = device(Random(8).matrix(steps + 1, n)), b = device(first), c = device(second);
    backend->add(*b, -3, *c, *a);
    EXPECT_LE(distance(host(*a), expected), 16 * epsilon) << "three arrays";  // of numbers up to 4
    backend->add(*b, -3, *c, *b);
    EXPECT_EQ(host(*b), host(*a)) << "into the first";
    backend->upload(first, *b);
    backend->add(*b, -3, *c, *c);
    EXPECT_EQ(host(*c), host(*a)) << "into the second";
  }
}

TEST_P(BackendArrays, SumsLeaveThePaddingOfRowsAlone) {
  // 17 columns have a stride of 24 on a device: the sum must not write padding that the transform reads.
  const RowMatrix values = Random(9).matrix(9, 17);
  const auto a = device(values), b = backend->array(9, 17), sine_of_sum = backend->array(9, 17);
  backend->add(*a, 1, *a, *b);
  backend->sine_transform(17, 9)->apply(*b, nullptr, *sine_of_sum, 0);
  // Sums of 17 products of numbers below 2.
  EXPECT_LE(distance(host(*sine_of_sum), 2 * values * reference::sine_matrix(17)), 100 * epsilon);
}

TEST_P(BackendArrays, DifferenceIsRelativeToLargeRowsOnly) {
  for (const auto& [steps, n] : shapes) {
    RowMatrix a = RowMatrix::Zero(steps + 1, n), b = a;
    const auto difference = [&] { return backend->difference(*device(a), *device(b)); };
    EXPECT_EQ(difference(), 0);
    b(steps, n - 1) = -0.25;
    EXPECT_EQ(difference(), 0.25) << "small rows count as they are";
    a.row(steps).array() += 4;
    b.row(steps).array() += 4;
    EXPECT_EQ(difference(), 0.0625) << "a row of size 4";
    a(0, n - 1) = 0.5;
    EXPECT_EQ(difference(), 0.5) << "the largest of all rows";
  }
}

TEST_P(BackendArrays, DifferenceOfWhatIsNotFinite) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (const bool in_first : {false, true})
      for (const Index cols : {33, 1500}) {
        RowMatrix a = RowMatrix::Zero(70, cols), b = a;
        a(1, 1) = 3;
        (in_first ? a : b)(68, cols - 2) = bad;
        EXPECT_TRUE(std::isnan(backend->difference(*device(a), *device(b)))) << bad;
      }
}

// Long rows: 4 at a place of the fifth, relative to 8 in the same row.
TEST_P(BackendArrays, DifferenceOfLongRows) {
  RowMatrix a = Random(18).matrix(9, 5000), b = a;
  a(4, 4321) = 8;
  b(4, 4321) = 4;
  EXPECT_EQ(backend->difference(*device(a), *device(b)), 0.5);
}

TEST_P(BackendArrays, DifferencesAreLookedAtLater) {
  const auto found = backend->differences(3);
  EXPECT_EQ(found->collect(), std::vector<double>(3, 0));
  const RowMatrix values = Random(16).matrix(50, 33), others = Random(17).matrix(50, 33);
  const auto a = device(values), b = device(others);
  for (int again = 0; again < 2; ++again) {  // a slot is reused, whatever it held
    found->submit(0, *a, *b);
    found->submit(2, *a, *a);
    backend->add(*b, 1, *b, *b);  // a submitted difference uses the arrays as they were
    EXPECT_EQ(found->collect()[0], backend->difference(*a, *device((again ? 2 : 1) * others)));
    EXPECT_EQ(found->collect()[1], 0);
    EXPECT_EQ(found->collect()[2], 0);
  }
  backend->add(*a, std::numeric_limits<double>::quiet_NaN(), *a, *a);
  found->submit(0, *a, *b);
  EXPECT_TRUE(std::isnan(found->collect()[0]));
}

// Column `column` alternates in the rows from .. to-1 around a curve with small curvature. Two more rows have second
// differences that alternate with them, except at the ends of the array.
RowMatrix alternating(Index rows, Index n, Index column, Index from, Index to) {
  RowMatrix y(rows, n);
  for (Index j = 0; j < rows; ++j)
    for (Index i = 0; i < n; ++i) y(j, i) = 2 + std::sin(1e-3 * double(j + 7 * i));
  for (Index j = from; j < to; ++j) y(j, column) += j % 2 ? 0.1 : -0.1;
  return y;
}

// Runs within and across chunks of rows and blocks of columns, and at the ends.
TEST_P(BackendArrays, AlternatingColumnsAreFoundWhereverTheyAre) {
  const Index rows = 300, n = 270, run = 16;
  const auto found = [&](const RowMatrix& y) { return backend->alternates(*device(y), run, 0.01); };
  EXPECT_FALSE(found(alternating(rows, n, 0, 0, 0)));
  for (const Index column : {Index(0), Index(255), n - 1})
    for (const Index from : {20l, 55l, 64l, 120l, 250l}) {
      EXPECT_TRUE(found(alternating(rows, n, column, from, from + run))) << column << ' ' << from;
      EXPECT_FALSE(found(alternating(rows, n, column, from, from + run - 4))) << column << ' ' << from;
    }
  EXPECT_TRUE(found(alternating(rows, n, 3, 0, run + 3))) << "the first rows";
  EXPECT_TRUE(found(alternating(rows, n, 3, rows - run - 3, rows))) << "the last rows";
  EXPECT_FALSE(found(1e-3 * alternating(rows, n, 3, 20, 60) + alternating(rows, n, 0, 0, 0))) << "too small";
  for (const Index few : {1, 2, 3, 17}) EXPECT_FALSE(found(RowMatrix::Zero(few, 5))) << few;
}

// Larger than the pieces of a device transfer; rows with and without padding.
TEST_P(BackendArrays, LargeArraysComeBackWhole) {
  for (const auto& [rows, n] : {std::pair<Index, Index>{6000, 127}, {70000, 9}, {3, 200000}}) {
    const RowMatrix values = Random(18).matrix(rows, n);
    EXPECT_EQ(host(*device(values)), values) << rows << ' ' << n;
  }
}

// Zeros of an array above 16 MB may stay on a device: mostly zero, zero in the first half alone, and -0, which is not.
TEST_P(BackendArrays, LargeArraysOfZerosComeBackWhole) {
  for (const auto& [rows, n] : {std::pair<Index, Index>{17000, 127}, {530000, 4}, {240000, 9}}) {
    RowMatrix values = Random(19).matrix(rows, n);
    values = (values.array() > -0.6).select(0, values);
    values(rows / 2, 1) = values(rows - 1, n - 1) = -0.0;
    const RowMatrix back = host(*device(values));
    EXPECT_EQ(back, values) << rows << ' ' << n;
    EXPECT_TRUE(std::signbit(back(rows / 2, 1)) && std::signbit(back(rows - 1, n - 1)));
    values.topRows(rows / 2).setZero();
    values.bottomRows(rows / 2).setConstant(3);
    EXPECT_EQ(host(*device(values)), values) << rows << ' ' << n;
  }
}

// A plan is made once and run again with the right-hand side of every cycle.
TEST_P(BackendArrays, MarchReadsItsResponseAnew) {
  const Index rows = 40;
  const DenseDynamics d{Matrix{{-1, 0.5}, {0, -2}}, Matrix{{1}, {1}}, Matrix{{1, -1}}};
  const LcpMatrix M = Matrix{{2}};
  const Recurrence recurrence = dense_recurrence(d, Rule::exponential, 0.1);
  const auto r = backend->array(rows, 1), y = backend->array(rows, 1), v = backend->array(rows, 1);
  MarchProblem problem;
  problem.M = &M;
  problem.lcp_class = LcpClass::P;
  problem.recurrence = &recurrence;
  problem.r = r.get();
  const auto plan = backend->march(problem, rows);
  for (const unsigned seed : {10u, 11u}) {
    const RowMatrix response = Random(seed).matrix(rows, 1);
    backend->upload(response, *r);
    backend->upload(RowMatrix::Zero(rows, 1), *y);
    ASSERT_EQ(plan->run(*y, *v).stopped, -1);
    const RowMatrix found = host(*y), w = 2 * found + response + host(*v);
    // min(y, w) of numbers of size 1, after a few operations.
    EXPECT_LE(found.cwiseMin(w).bottomRows(rows - 1).cwiseAbs().maxCoeff(), 1e-14) << seed;
    EXPECT_GT(found.maxCoeff(), 0.1) << seed;
  }
}

}  // namespace
}  // namespace bromwich
