// Parts of a cycle of multigrid in time: kernels and weights of coarse grids, queued batches, stopping criteria.

#include "catalogue/catalogue.hpp"
#include "core/iteration/functional_iteration.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/multigrid/cycle_watch.hpp"
#include "core/multigrid/multigrid.hpp"
#include "core/multigrid/time_levels.hpp"
#include "tests/support/expanding.hpp"
#include "tests/support/queueing_backend.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace bromwich {
namespace {

using reference::Random;

Scene membrane(double Q) { return make_scene("signorini", {{"Q", Q}}); }

ModalRecurrence some_exponentials(Index n) {
  Random random{31};
  ModalRecurrence r;
  r.decay = random.matrix(3, n).cwiseAbs();
  r.output = random.matrix(3, n);
  r.start = random.matrix(3, n);
  r.w0 = random.vector(n);
  r.w1 = random.vector(n);
  r.s1 = random.vector(n);
  return r;
}

// Two ways to the same weights. S_1 of the fine grid acts on no coarse grid point.
TEST(TimeLevels, ExponentialsOfTheCoarseGridAreThoseOfItsTable) {
  const ModalRecurrence fine = some_exponentials(5);
  const LagTable expected = coarsen(lag_table(fine, 40)), found = lag_table(coarsen(fine), 20);
  // Sums of ten products of numbers up to 2; the last lag of W acts on nothing.
  EXPECT_LE(distance(found.W.topRows(20), expected.W.topRows(20)), 100 * epsilon);
  EXPECT_LE(distance(found.S.topRows(20), expected.S.topRows(20)), 100 * epsilon);
}

TEST(TimeLevels, AKernelKnowsTheModesOfInjectedValues) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = membrane(15);
  const DiscreteProblem p = discretise(scene, *backend, 64);
  const auto op = make_time_operator(p);
  TimeLevels levels = time_levels(*op, {});
  TimeLevel &fine = levels[0], &coarse = levels[1];
  backend->upload(Random(32).matrix(65, 15), *fine.y);
  fine.kernel->apply(*fine.y, *fine.v, 0);
  coarse.kernel->apply_injected(*fine.kernel, *fine.y, *coarse.y, *coarse.v);
  RowMatrix found, expected;
  backend->download(*coarse.v, found);
  backend->inject(*fine.y, *coarse.y);
  coarse.kernel->apply(*coarse.y, *coarse.v, 0);
  backend->download(*coarse.v, expected);
  EXPECT_EQ(found, expected) << "the same operations on the same modes";
}

// ---- queued cycles ----

Result solved_by(Backend& backend, const Scene& scene, Index J, double share = 0) {
  Options options = options_for(Method::multigrid, J);
  options.tuning.algebraic_share = share;
  return solve(scene, backend, options);
}

TEST(QueuedMultigrid, DoesWhatTheOtherDoes) {
  for (const Scene& scene : {membrane(15), expanding()})
    for (const bool modes : {false, true}) {
      const Index J = scene.constraints() > 1 ? 128 : 1280;
      QueueLog log;
      log.modes = modes;
      QueueingBackend queueing(log);
      const Result found = solved_by(queueing, scene, J), expected = run(scene, Method::multigrid, J);
      ASSERT_EQ(found.status, Status::solved) << found.reason;
      EXPECT_EQ(found.y, expected.y) << "the same operations in the same order";
      EXPECT_EQ(found.iterations, expected.iterations);
      EXPECT_EQ(found.lcp.newton, expected.lcp.newton);
      EXPECT_EQ(found.cycles, expected.cycles);
      EXPECT_GT(log.batches, 0);
      EXPECT_GT(log.replays, 0);
      EXPECT_EQ(log.in_modes, modes && scene.constraints() > 1 ? log.batches : 0);
    }
}

TEST(QueuedMultigrid, StopsWhereTheOtherStops) {
  for (const double Q : {15., 127.})
    for (const double share : {0.1, 1e-6}) {
      const auto host = make_cpu_backend(1);
      QueueLog log;
      log.modes = Q > 15;
      QueueingBackend queueing(log);
      const Result found = solved_by(queueing, membrane(Q), 256, share),
                   expected = solved_by(*host, membrane(Q), 256, share);
      ASSERT_EQ(found.status, Status::solved) << found.reason;
      EXPECT_EQ(found.y, expected.y) << Q << ' ' << share;
      EXPECT_EQ(found.cycles, expected.cycles) << Q << ' ' << share;
      EXPECT_EQ(found.iterations, expected.iterations) << Q << ' ' << share;
    }
}

// Any batch may fail: in the nested start, a cycle, the search for a correction, a sweep.
TEST(QueuedMultigrid, StopsAsWellAfterAnUnsolvedBatch) {
  const Scene scene = membrane(127);
  const double share = 1e-4;
  QueueLog all;
  QueueingBackend undisturbed(all);
  const Result expected = solved_by(undisturbed, scene, 256, share);
  const RowMatrix exact = solved_y(scene, Method::march, 256);
  for (const long failures : {1l, 1000000l})  // one, or all from there
    for (long failing = 1; failing < all.batches; failing += 7) {
      QueueLog log;
      log.failing = failing;
      log.failures = failures;
      QueueingBackend backend(log);
      const Result found = solved_by(backend, scene, 256, share);
      ASSERT_EQ(found.status, Status::solved) << failing << found.reason;
      ASSERT_TRUE(found.algebraic_error && expected.error_estimate) << failing;
      EXPECT_LE(*found.algebraic_error, 1.01 * share * *expected.error_estimate) << failing;
      // The estimate is relative to max(1, |y|) of a time point.
      EXPECT_LE(distance(found.y, exact), *found.algebraic_error * std::max(1., exact.maxCoeff())) << failing;
    }
}

// An unsolved batch in the nested start, and one in the second cycle.
TEST(QueuedMultigrid, DoesAgainWhatStayedUnsolved) {
  const Scene scene = membrane(15);
  QueueLog all;
  QueueingBackend undisturbed(all);
  const Result expected = solved_by(undisturbed, scene, 128);
  for (const long failing : {2l, all.batches - 1}) {
    QueueLog log;
    log.failing = failing;
    QueueingBackend backend(log);
    const Result found = solved_by(backend, scene, 128);
    ASSERT_EQ(found.status, Status::solved) << failing << found.reason;
    EXPECT_LE(distance(found.y, expected.y), same_problem) << failing;
    EXPECT_EQ(found.lcp.unsolved, 0) << failing;
    EXPECT_GT(log.waited, all.waited) << failing << ": again, batch by batch";
  }
}

// ---- watching ----

TEST(CycleWatch, EndsWhereWhatIsLeftIsBelowTheTolerance) {
  CycleWatch watch(1e-6, INFINITY);
  EXPECT_FALSE(watch.after(1e-1));
  EXPECT_EQ(watch.left(), INFINITY) << "one change says nothing of the next";
  EXPECT_EQ(watch.contraction(), 0);
  EXPECT_FALSE(watch.after(1e-3));
  EXPECT_DOUBLE_EQ(watch.contraction(), 1e-2);
  EXPECT_EQ(watch.left(), INFINITY) << "the first contraction is flattered by the start";
  const auto outcome = watch.after(1e-5);
  ASSERT_TRUE(outcome);
  EXPECT_EQ(outcome->status, Status::solved);
  EXPECT_NEAR(watch.left(), 1e-5 * 0.01 / 0.99, 1e-20);
}

TEST(CycleWatch, TakesTheContractionThatACoarserGridHasSeen) {
  CycleWatch watch(1e-12, 0.01);
  EXPECT_FALSE(watch.after(1e-2));
  EXPECT_DOUBLE_EQ(watch.left(), 1e-2 * 0.01 / 0.99);
  EXPECT_EQ(watch.contraction(), 0) << "this grid has not seen it";
}

TEST(CycleWatch, EndsWhereCyclesDoNotContract) {
  CycleWatch watch(1e-12, INFINITY);
  EXPECT_FALSE(watch.after(1));
  EXPECT_FALSE(watch.after(0.9));
  const auto outcome = watch.after(0.8);
  ASSERT_TRUE(outcome);
  EXPECT_EQ(outcome->status, Status::tolerance_not_met);
  EXPECT_EQ(CycleWatch(1e-12, INFINITY).after(NAN)->status, Status::nonfinite);
}

TEST(CycleWatch, ForgetsWhatWasSeenWhereCyclesAreOthers) {
  CycleWatch watch(1e-12, 0.01);
  EXPECT_FALSE(watch.after(1));
  EXPECT_FALSE(watch.after(0.9));
  watch.restart();
  EXPECT_EQ(watch.left(), INFINITY);
  EXPECT_EQ(watch.contraction(), 0);
  EXPECT_FALSE(watch.after(0.8)) << "the second slow cycle in a row, were it not for the restart";
  EXPECT_EQ(watch.left(), INFINITY) << "nothing is known of the new cycles";
  EXPECT_FALSE(watch.after(0.7));
  EXPECT_TRUE(watch.after(0.65)) << "two slow ones again";
  // The number of cycles is limited: it always ends.
  CycleWatch patient(1e-300, INFINITY);
  Index cycles = 1;
  for (double change = 1; !patient.after(change); change *= 0.4, ++cycles)
    if (cycles % 3 == 0) patient.restart();
  EXPECT_EQ(cycles, CycleWatch::most_cycles);
}

// ---- the coarsest grid ----

TEST(Multigrid, ContractsAsWellWithSweepsOnTheCoarsestGridAsWithAMarch) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = membrane(63);
  const Index J = 256;
  const DiscreteProblem p = discretise(scene, *backend, J);
  const RowMatrix exact = solved_y(scene, Method::march, J);
  for (const bool marched : {false, true}) {
    const Options options;
    const auto op = make_time_operator(p);
    TimeLevels levels = time_levels(*op, options);
    EXPECT_FALSE(levels.grids.back()->march) << "its symbol is known";
    if (marched) levels.prepare_march();
    Result result;
    Multigrid multigrid(*backend, options, levels);
    multigrid.begin(options, result);
    multigrid.nest(exact.row(0).transpose());
    RowMatrix y;
    const auto error = [&] {
      backend->download(*levels[0].y, y);
      return distance(y, exact);
    };
    double before = error();
    for (int cycle = 0; cycle < 3; ++cycle) {
      multigrid.cycle(0);
      const double after = error();
      EXPECT_LE(after, 0.1 * before) << marched << ' ' << cycle;
      before = after;
    }
  }
}

TEST(Multigrid, MarchesTheCoarsestGridWhereNoSymbolIsKnown) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = expanding();
  const DiscreteProblem p = discretise(scene, *backend, 1280);
  EXPECT_TRUE(time_levels(*make_time_operator(p), {}).grids.back()->march);
}

TEST(Multigrid, IsInterruptedWithinTheMarchOfTheCoarsestGrid) {
  // Polled before the coarsest grid, the first, and then after 64 of its steps.
  Options options = options_for(Method::multigrid, 1280);
  int asked = 0;
  options.interrupted = [&] { return ++asked == 2; };
  const Result result = run(expanding(), options);
  EXPECT_EQ(result.status, Status::interrupted);
  EXPECT_EQ(asked, 2);
  EXPECT_TRUE(result.y.array().isNaN().all());
}

// Sweeps on finer grids cost more; only the two finest grids must smooth well.
TEST(TimeLevels, CoarseGridsTakeFewerSweepsAndEndEarly) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = membrane(127);
  const DiscreteProblem p = discretise(scene, *backend, 1024);
  const auto op = make_time_operator(p);
  const TimeLevels levels = time_levels(*op, {});
  ASSERT_EQ(levels.size(), 4u) << "1024, 512, 256, 128";
  EXPECT_LT(levels.grids[2]->sweeps, levels.grids[2]->coarsest_sweeps - 1);
  EXPECT_EQ(levels.grids[3]->sweeps, levels.grids[3]->coarsest_sweeps);
  const DiscreteProblem few = discretise(scene, *backend, 128);
  EXPECT_EQ(time_levels(*make_time_operator(few), {}).size(), 3u) << "three grids, for an estimate of the error";
}

// ---- no further than is useful ----

TEST(Multigrid, StopsWhereFurtherCyclesAreOfNoUse) {
  for (const double Q : {15., 63., 127.})
    for (const Index J : {128, 512}) {
      const Scene scene = membrane(Q);
      Options options = options_for(Method::multigrid, J);
      options.tuning.algebraic_share = 0.1;
      const Result found = run(scene, options), tight = run(scene, Method::multigrid, J);
      ASSERT_EQ(found.status, Status::solved) << found.reason;
      const RowMatrix finer = solved_y(scene, Method::march, 4 * J);
      double left = 0, error = 0, size = 1;
      for (Index j = 1; j <= J; ++j) {
        left = std::max(left, (found.y.row(j) - tight.y.row(j)).cwiseAbs().maxCoeff());
        error = std::max(error, (tight.y.row(j) - finer.row(4 * j)).cwiseAbs().maxCoeff());
        size = std::max(size, tight.y.row(j).maxCoeff());
      }
      EXPECT_LE(left, 0.1 * error) << Q << ' ' << J;
      EXPECT_LT(found.cycles, tight.cycles) << Q << ' ' << J;
      ASSERT_TRUE(found.algebraic_error) << Q << ' ' << J;
      EXPECT_GE(*found.algebraic_error * size, left) << Q << ' ' << J;
    }
}

TEST(Multigrid, RefusesAShareThatIsNoPart) {
  Options options = options_for(Method::multigrid, 64);
  for (const double share : {-0.1, 1.0, double(NAN)}) {
    options.tuning.algebraic_share = share;
    EXPECT_THROW(run(membrane(3), options), Error) << share;
  }
}

}  // namespace
}  // namespace bromwich
