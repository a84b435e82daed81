// Which parts of steps share the matrices of one length (core/host/stage_stepper.hpp).

#include "core/host/stage_stepper.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

// Steps of h = 1/J, each divided behind a third by a jump of a source at t = (k + 1/3) h. All ends are rounded, so that
// the lengths of parts differ by up to 2^-53 of T = J h: by J 2^-53 of h.
TEST(LengthsOfSteps, AreFewWhereTimesAreRounded) {
  for (const Index J : {1000, 100000, 2000000}) {
    StageProblem p;
    p.h = 1 / double(J);
    for (Index k = 0; k < J; ++k) {
      const double begin = double(k) / double(J), jump = (double(k) + 1.0 / 3) / double(J),
                   end = double(k + 1) / double(J);
      p.lengths.push_back(jump - begin);
      p.lengths.push_back(end - jump);
    }
    const host::Lengths lengths(p, 2 * J + 1);
    EXPECT_LE(lengths.kinds(), 5) << J;  // h, and each of two lengths on both sides of a bound of its digits
    for (Index j = 1; j <= 2 * J; j += 997) {
      const double own = p.lengths[std::size_t(j) - 1], taken = lengths.size(lengths.kind(j));
      EXPECT_LE(std::abs(own - taken), 8 * epsilon + 0x1p-44 * p.h) << J;
    }
  }
}

// Lengths that differ by more than rounding are different.
TEST(LengthsOfSteps, AreNotThoseOfOthers) {
  StageProblem p;
  p.h = 1e-3;
  p.lengths = {1e-3, 0.5e-3, 0.5e-3 * (1 + 1e-9), 0.25e-3};
  EXPECT_EQ(host::Lengths(p, 5).kinds(), 4);
}

}  // namespace
}  // namespace bromwich
