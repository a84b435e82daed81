#pragma once
// A solve whose time points are divided among ranks, held against one rank that has them all.

#include "ranks/slab_backend.hpp"
#include "tests/support/run.hpp"
#include "tests/support/thread_ranks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace bromwich {

/// y of 1, 2, 3, 4 and 7 ranks to rounding of sums in another order, and bit for bit from run to run.
inline void expect_solution_of_one_rank(const Scene& scene, const Options& options, const std::string& what) {
  const Result expected = run(scene, options);
  ASSERT_EQ(expected.status, Status::solved) << what << ": " << expected.reason;
  const double size = std::max(1., expected.y.cwiseAbs().maxCoeff());
  for (const int ranks : {1, 2, 3, 4, 7}) {
    std::vector<RowMatrix> found;
    for (int again = 0; again < (ranks == 3 ? 2 : 1); ++again)
      on_threads(ranks, [&](Communicator& communicator) {
        const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
        const Result result = solve(scene, *backend, options);
        EXPECT_EQ(result.status, Status::solved) << what << ": " << result.reason;
        EXPECT_EQ(result.form, expected.form) << what;
        EXPECT_EQ(result.kernel, expected.kernel) << what;
        EXPECT_LE(distance(result.y, expected.y), 1e-12 * size) << what << ", " << ranks << " ranks";
        EXPECT_LE(result.residual, std::max(1e-12, 2 * expected.residual)) << what;
        if (communicator.rank() == 0) found.push_back(result.y);
      });
    EXPECT_EQ(found.front(), found.back()) << what << ", from run to run";
  }
}

}  // namespace bromwich
