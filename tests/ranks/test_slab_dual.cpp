// Cycles in w whose time points are divided among ranks, held against one rank that has them all.

#include "ranks/slab_stages.hpp"

#include "ranks/slab_backend.hpp"
#include "ranks/slabs.hpp"
#include "tests/multigrid/dual_scenes.hpp"
#include "tests/ranks/divided_solves.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/row_ranks.hpp"
#include "tests/support/thread_ranks.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace bromwich {
namespace {

using reference::Random;

struct DualCase {
  const char* name;
  Scene scene;
  Index steps;
  bool by_euler;
};

// M = 0 in modes, with a start and a source through B; a dense scene; entries of a matrix by shared poles.
std::vector<DualCase> dual_cases() {
  Scene driven = compliant(7, 0);
  for (Index i = 0; i < driven.x0.size(); ++i) driven.x0[i] = 0.1 + 0.05 * std::sin(double(i));
  driven.f = [](double t, Eigen::Ref<Vector> phi) {
    for (Index i = 0; i < phi.size(); ++i) phi[i] = -0.3 * std::sin(4 * t + double(i));
  };
  driven.f_entry = SourceEntry::through_B;
  const Scene sparse = varying(3, 24, 1e-2);
  return {{"stages", compliant(7, 0), 1024, false},
          {"Euler", compliant(7, 0), 512, true},
          {"driven stages", driven, 512, false},
          {"driven Euler", driven, 256, true},
          {"an uneven grid", compliant(5, 0.01), 720, false},
          {"sparse stages", sparse, 256, false},
          {"sparse Euler", sparse, 256, true},
          {"dense", random_contact(1, 4, 2, 1e-3), 512, true}};
}

Options options_of(const DualCase& one) {
  Options options = options_for(Method::dual, one.steps);
  options.iteration_tolerance = 1e-14;
  options.tuning.dual_by_euler = one.by_euler;
  return options;
}

// The same w to rounding of sums in another order; V_0 is below 1e2 here, as much as y = V w + s has of it.
TEST(SlabDual, FindsTheSolutionOfOneRank) {
  for (const DualCase& one : dual_cases()) {
    EXPECT_EQ(run(one.scene, options_of(one)).form, "dual") << one.name;
    expect_solution_of_one_rank(one.scene, options_of(one), one.name);
  }
}

// The same on arrays that are not in reach of the host, whose rows travel by themselves.
TEST(SlabDual, FindsTheSolutionWhereRowsTravel) {
  for (const DualCase& one : dual_cases()) {
    if (one.steps > 720) continue;
    const Options options = options_of(one);
    const Result expected = run(one.scene, options);
    for (const int ranks : {2, 3})
      on_threads(ranks, [&](Communicator& communicator) {
        const auto backend = make_backend_over_rows(communicator);
        const Result result = solve(one.scene, *backend, options);
        EXPECT_EQ(result.status, Status::solved) << one.name << ": " << result.reason;
        EXPECT_LE(distance(result.y, expected.y), 1e-12 * std::max(1., expected.y.cwiseAbs().maxCoeff()))
            << one.name << ", " << ranks << " ranks";
      });
  }
}

// Both stages of a step lie in one slab, also where the grid of the ends of steps is held as a whole.
TEST(SlabStages, AreInOneSlab) {
  for (const int ranks : {2, 3, 4, 7})
    on_threads(ranks, [&](Communicator& communicator) {
      for (const Index steps : {33 * ranks, 50 * ranks, 65 * ranks, 500, 1023, 1024}) {
        const Slabs stages = slabs_of(2 * steps + 1, communicator), ends = slabs_of(steps + 1, communicator);
        for (const Index end : stages.ends) EXPECT_EQ(end % 2, 0) << steps;
        for (std::size_t r = 0; r < ends.ends.size(); ++r) EXPECT_EQ(stages.ends[r], 2 * ends.ends[r]) << steps;
      }
    });
}

// Grids of which both, one or none are divided.
TEST(SlabStages, AreTakenPutSweptAndRestricted) {
  const StageDivisors d{1.5, 0.25, 2};
  for (const Index steps : {500, 100, 65, 30}) {
    const RowMatrix r = Random(1).matrix(2 * steps + 1, 3), v = Random(2).matrix(2 * steps + 1, 3),
                    y = Random(3).matrix(2 * steps + 1, 3).cwiseMax(0), coarse_v = Random(4).matrix(steps + 1, 3);
    const auto moved = [&](Backend& backend) {
      const auto R = backend.array(2 * steps + 1, 3), V = backend.array(2 * steps + 1, 3),
                 Y = backend.array(2 * steps + 1, 3), A = backend.array(steps + 1, 3), B = backend.array(steps + 1, 3),
                 C = backend.array(steps + 1, 3), D = backend.array(steps + 1, 3), Z = backend.array(2 * steps + 1, 3);
      backend.upload(r, *R);
      backend.upload(v, *V);
      backend.upload(y, *Y);
      backend.upload(coarse_v, *D);
      std::vector<RowMatrix> values(6);
      backend.restrict_stages(*R, *V, *Y, *D, *A, *B, *C);
      backend.download(*A, values[0]);
      backend.download(*B, values[1]);
      backend.download(*C, values[2]);
      backend.take_stages(*R, *A, *B);
      backend.download(*A, values[3]);
      backend.put_stages(*A, *B, *Z);
      backend.download(*Z, values[4]);
      backend.sweep_stages(d, *R, *V, *Y);
      backend.download(*Y, values[5]);
      return values;
    };
    const auto cpu = make_cpu_backend(1);
    const auto expected = moved(*cpu);
    for (const int ranks : {1, 2, 3, 7})
      on_threads(ranks, [&](Communicator& communicator) {
        for (const bool rows_travel : {false, true}) {
          const auto backend =
              rows_travel ? make_backend_over_rows(communicator) : make_slab_backend(make_cpu_backend(1), communicator);
          const auto found = moved(*backend);
          for (std::size_t i = 0; i < expected.size(); ++i)
            EXPECT_LE(distance(found[i], expected[i]), 8 * epsilon * 10) << ranks << " ranks, " << steps << ", " << i;
        }
      });
  }
}

}  // namespace
}  // namespace bromwich
