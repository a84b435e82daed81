// Threads that share short work (kernels/helpers.hpp); powers of decays (kernels/entry_powers.hpp).

#include "core/base/first_touch.hpp"
#include "kernels/entry_powers.hpp"
#include "kernels/helpers.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <thread>
#include <vector>

namespace bromwich {
namespace {

// Each number is processed once, by any thread; no thread is at work afterwards.
TEST(Helpers, ShareWorkOutOnce) {
  for (const int count : {0, 1, 5}) {
    Helpers helpers(count);
    for (int round = 0; round < 200; ++round) {
      std::vector<int> done(50, 0);
      std::atomic<std::size_t> next = 0;
      bool began = false;
      helpers.share(
          [&] {
            for (std::size_t i; (i = next++) < done.size();) ++done[i];
          },
          [&] { began = true; });
      EXPECT_TRUE(began);
      ASSERT_EQ(done, std::vector<int>(50, 1)) << count << " helpers, round " << round;
    }
  }
}

TEST(Helpers, EndWithoutWork) { Helpers unused(3); }

// Against powers in extended precision. n - 1 roundings of relative size u = eps / 2 make at most
// (n - 1) u / (1 - (n - 1) u); the last conversion to double adds less than u.
TEST(EntryPowers, ErrByNoMoreThanTheirRoundings) {
  const RowMatrix base =
      RowMatrix::NullaryExpr(3, 40, [](Index i, Index j) { return 1 - 1e-4 * double(1 + 40 * i + j); });
  for (const Index exponent : {1, 2, 3, 31, 64, 1000, 4097}) {
    const RowMatrix power = cuda::entry_powers(base, exponent);
    const double u = 0.5 * std::numeric_limits<double>::epsilon(),
                 bound = double(exponent) * u / (1 - double(exponent) * u);
    for (Index i = 0; i < base.size(); ++i) {
      const long double exact = std::pow(static_cast<long double>(base.data()[i]), static_cast<long double>(exponent));
      EXPECT_LE(std::abs(static_cast<double>((power.data()[i] - exact) / exact)), bound) << exponent << ", entry " << i;
    }
  }
}

// Every page is written, nothing beyond the values, and nothing after the end.
TEST(FirstTouch, WritesAllPages) {
  constexpr std::size_t count = (std::size_t(1) << 19) + 700, page = 512;
  std::vector<double> values(count + 1, 3);
  { const FirstTouch touch(values.data(), count); }
  if (std::thread::hardware_concurrency() > 1) {
    std::size_t since = page;
    for (std::size_t i = 0; i < count; ++i, ++since) {
      if (std::isnan(values[i])) since = 0;
      ASSERT_LT(since, page) << i;
    }
  }
  EXPECT_EQ(values[count], 3);
  values.assign(count, 3);
  EXPECT_EQ(values, std::vector<double>(count, 3));
}

}  // namespace
}  // namespace bromwich
