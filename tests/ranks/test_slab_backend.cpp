// Solves whose time points are divided among ranks, held against one rank that has them all.

#include "ranks/slab_backend.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/pole_fit.hpp"
#include "ranks/slab_array.hpp"
#include "ranks/slab_plans.hpp"
#include "ranks/slab_states.hpp"
#include "ranks/slabs.hpp"
#include "tests/ranks/divided_solves.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/row_ranks.hpp"
#include "tests/support/run.hpp"
#include "tests/support/thread_ranks.hpp"

#include <gtest/gtest.h>
#include <Eigen/SparseLU>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

// ---- which rows are whose ----

TEST(Slabs, CoverAllRowsOnceAndKeepTheirTimes) {
  for (const int ranks : {2, 3, 4, 7})
    on_threads(ranks, [&](Communicator& communicator) {
      for (const Index steps : {16 * ranks, 1000, 1024, 4096}) {
        const Slabs fine = slabs_of(steps + 1, communicator);
        if (fine.whole()) {
          EXPECT_LT(steps, 16 * ranks);
          continue;
        }
        EXPECT_EQ(fine.ends.front(), 0);
        EXPECT_EQ(fine.ends.back(), steps);
        for (int r = 0; r < ranks; ++r) EXPECT_GE(fine.count(r), 14) << "the last bits of an uneven division";
        const Slabs coarse = slabs_of(steps / 2 + 1, communicator);
        if (steps % 2 != 0 || coarse.whole()) continue;
        for (std::size_t r = 0; r < fine.ends.size(); ++r) EXPECT_EQ(fine.ends[r], 2 * coarse.ends[r]);
      }
    });
}

// ---- arrays and reports ----

// Grids of which both, one or none are divided, with ends of slabs that are points of the coarse grid or not.
TEST(SlabBackend, MovesValuesBetweenGrids) {
  const auto cpu = make_cpu_backend(1);
  for (const auto& grids :
       {std::pair<Index, Index>(1024, 512), {1024, 128}, {768, 256}, {128, 64}, {24, 12}, {700, 350}})
    for (const int ranks : {1, 2, 3, 7}) {
      const Index fine = grids.first, coarse = grids.second;
      const RowMatrix f = Random(1).matrix(fine + 1, 3), c = Random(2).matrix(coarse + 1, 3),
                      old = Random(3).matrix(coarse + 1, 3);
      const auto moved = [&](Backend& backend) {
        const auto F = backend.array(fine + 1, 3), G = backend.array(fine + 1, 3), C = backend.array(coarse + 1, 3),
                   O = backend.array(coarse + 1, 3), V = backend.array(coarse + 1, 3), R = backend.array(coarse + 1, 3);
        backend.upload(f, *F);
        backend.upload(c, *C);
        backend.upload(old, *O);
        backend.add(*F, 0.5, *F, *G);
        backend.interpolate(*C, O.get(), *G);
        backend.interpolate(*C, nullptr, *G);
        backend.inject(*G, *V);
        backend.restrict_problem(*F, *G, *F, *V, *R, *C, *O);
        std::vector<RowMatrix> values(4);
        backend.download(*G, values[0]);
        backend.download(*R, values[1]);
        backend.download(*C, values[2]);
        backend.download(*O, values[3]);
        values.push_back(RowMatrix::Constant(1, 1, backend.difference(*R, *C)));
        return values;
      };
      const auto expected = moved(*cpu);
      on_threads(ranks, [&](Communicator& communicator) {
        for (const bool rows_travel : {false, true}) {
          const auto backend =
              rows_travel ? make_backend_over_rows(communicator) : make_slab_backend(make_cpu_backend(1), communicator);
          const auto found = moved(*backend);
          for (std::size_t i = 0; i < expected.size(); ++i)
            EXPECT_LE(distance(found[i], expected[i]), 8 * epsilon * 10)
                << ranks << " ranks, " << fine << ", value " << i << ", rows " << rows_travel;
        }
      });
    }
}

TEST(SlabBackend, ReportsWhatOneRankReports) {
  const Index J = 400, n = 3;
  const Matrix M = (Matrix(n, n) << 2, 1, 0, -1, 2, 1, 0, 1, 2).finished();
  RowMatrix r = Random(5).matrix(J + 1, n);
  const auto report_of = [&](Backend& backend, const RowMatrix& q, Index first, double& residual) {
    const auto R = backend.array(J + 1, n), V = backend.array(J + 1, n), Y = backend.array(J + 1, n);
    backend.upload(q, *R);
    const auto lcp = backend.lcp(LcpMatrix(M), LcpClass::P, J + 1);
    lcp->solve(*R, *V, *Y, 0, 1e-12);
    residual = lcp->residual(*R, *V, *Y);
    RowMatrix moved = q;
    moved.row(333) *= -1;
    backend.upload(moved, *R);
    return lcp->solve(*R, *V, *Y, first, 1e-12);
  };
  const auto cpu = make_cpu_backend(1);
  for (const double value : {1., std::nan("")})
    for (const Index first : {0, 150, 350}) {
      r(390, 1) = value;
      double residual = 0;
      const LcpReport expected = report_of(*cpu, r, first, residual);
      EXPECT_EQ(expected.settled, first > 333 ? (std::isnan(value) ? 390 : J + 1) : 333) << "of the test itself";
      for (const int ranks : {2, 3, 4})
        on_threads(ranks, [&](Communicator& communicator) {
          const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
          double of_ranks = 0;
          const LcpReport found = report_of(*backend, r, first, of_ranks);
          EXPECT_EQ(found.settled, expected.settled);
          EXPECT_EQ(found.count.solved, expected.count.solved);
          EXPECT_EQ(found.count.unsolved, expected.count.unsolved);
          EXPECT_EQ(found.finite, expected.finite);
          EXPECT_EQ(found.magnitude, expected.magnitude);
          EXPECT_EQ(found.change, expected.change);
          EXPECT_TRUE(of_ranks == residual || (std::isnan(of_ranks) && std::isnan(residual)));
        });
    }
}

// ---- whole solves ----

struct Case {
  Scene scene;
  Method method;
  Index steps;
};

std::vector<Case> cases() {
  const Scene face = make_scene("signorini3d", {{"Q", 5}}), line = make_scene("signorini", {{"Q", 15}}),
              dense = make_scene("dlcp-small", {});
  Scene insulated = line;  // modes that are no sine vectors
  get<KroneckerDynamics>(insulated.dynamics).along.first = 1;
  insulated.M = Tridiagonal{Vector::Zero(15), Vector::Constant(15, 4), Vector::Zero(15)};
  return {{line, Method::multigrid, 1024},   {line, Method::contour, 500},        {face, Method::multigrid, 512},
          {insulated, Method::contour, 500}, {insulated, Method::multigrid, 512}, {face, Method::contour, 500},
          {dense, Method::multigrid, 1024},  {dense, Method::contour, 512}};
}

// The same problems are solved to the same tolerance of 1e-12; sums of carries round in another order.
TEST(SlabBackend, FindsTheSolutionOfOneRank) {
  for (const Case& one : cases()) {
    Options options = options_for(one.method, one.steps);
    options.iteration_tolerance = 1e-14;
    expect_solution_of_one_rank(one.scene, options, one.scene.name + ", " + to_string(one.method));
  }
}

// The same on arrays that are not in reach of the host, whose rows travel by themselves.
TEST(SlabBackend, FindsTheSolutionWhereRowsTravel) {
  const Scene line = make_scene("signorini", {{"Q", 7}}), face = make_scene("signorini3d", {{"Q", 3}}),
              dense = make_scene("dlcp-small", {});
  for (const Case& one : {Case{line, Method::multigrid, 768}, Case{line, Method::contour, 300},
                          Case{face, Method::multigrid, 512}, Case{dense, Method::contour, 256}}) {
    Options options = options_for(one.method, one.steps);
    options.iteration_tolerance = 1e-14;
    const Result expected = run(one.scene, options);
    ASSERT_EQ(expected.status, Status::solved) << one.scene.name << ": " << expected.reason;
    for (const int ranks : {2, 3, 4})
      on_threads(ranks, [&](Communicator& communicator) {
        const auto backend = make_backend_over_rows(communicator);
        const Result result = solve(one.scene, *backend, options);
        EXPECT_EQ(result.status, Status::solved) << one.scene.name << ": " << result.reason;
        EXPECT_LE(distance(result.y, expected.y), 1e-12 * std::max(1., expected.y.cwiseAbs().maxCoeff()))
            << one.scene.name << ", " << to_string(one.method) << ", " << ranks << " ranks";
        EXPECT_LE(result.residual, 1e-12);
      });
  }
}

// The sixth sweep alone: one convolution and one report of nine numbers.
TEST(SlabBackend, ASweepSendsACarryAndAReport) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  const Index J = 512;
  const auto cpu = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *cpu, J);
  const SharedWeights weights = make_time_operator(p)->weights(J, nullptr, 0);
  const ModalRecurrence& modes = *modal_recurrence_of(*weights);
  for (const int ranks : {2, 4}) {
    const auto sent_in = [&](Index sweeps) {
      Options options = options_for(Method::contour, J);
      options.max_iterations = sweeps;
      Traffic all;
      for (const Traffic& sent : on_threads(ranks, [&](Communicator& communicator) {
             const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
             EXPECT_EQ(solve(scene, *backend, options).iterations, sweeps);
           })) {
        all.shifted += sent.shifted;
        all.gathered += sent.gathered;
        all.compared += sent.compared;
        all.broadcast += sent.broadcast;
      }
      return all;
    };
    const Traffic five = sent_in(5), six = sent_in(6);
    const std::size_t R = std::size_t(ranks), n = 15, K = std::size_t(modes.exponentials());
    std::size_t lasting = 0;
    for (Index i = 0; ranks > 2 && i < modes.decay.size(); ++i)
      lasting += std::pow(modes.decay.data()[i], double(J / ranks)) > forgotten;
    EXPECT_EQ(six.shifted - five.shifted, 8 * (R - 1) * n * (K + 1));
    EXPECT_EQ(six.gathered - five.gathered, 8 * R * (R - 1) * (lasting + 9));
    EXPECT_EQ(six.compared, five.compared);
    EXPECT_EQ(six.broadcast, five.broadcast);
  }
}

TEST(SlabBackend, DividesShiftedSolvesByNodes) {
  const DenseDynamics d{(Matrix(3, 3) << -1, 0, 0, 0.3, -2, 0, 0.1, 0.2, -3).finished(), Random(7).matrix(3, 2),
                        Random(8).matrix(2, 3)};
  const ComplexVector nodes =
      (Random(9).vector(11).cast<Complex>() + Complex(0, 1) * Random(10).vector(11)).array() + 2.;
  const ComplexMatrix expected = Dynamics(d)->shifted_solves(nodes, HostThreads());
  ComplexVector bad = nodes;
  bad[9] = -2;  // an eigenvalue, which one rank meets
  for (const int ranks : {1, 2, 3, 7})
    on_threads(ranks, [&](Communicator& communicator) {
      const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
      EXPECT_LE((backend->resolvent(d, nodes) - expected).cwiseAbs().maxCoeff(), 1e-14) << ranks << " ranks";
      EXPECT_THROW(backend->resolvent(d, bad), SingularShift);
    });
}

// A scene with many states whose shifted systems are prepared by a callback, which counts them.
Scene counting_heat(std::atomic<int>& prepared) {
  Scene scene = make_scene("signorini", {{"Q", 12}});
  const SparseDynamics d = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  SuppliedDynamics supplied;
  supplied.states = d.A.rows();
  supplied.B = d.B;
  supplied.N = d.N;
  supplied.shifted = [A = d.A, &prepared](Complex z) -> ShiftedSolve {
    ++prepared;
    Eigen::SparseMatrix<Complex> shifted(A.rows(), A.cols());
    shifted.setIdentity();
    shifted = z * shifted - A.cast<Complex>();
    const auto lu = std::make_shared<Eigen::SparseLU<Eigen::SparseMatrix<Complex>>>(shifted);
    return [lu](const ComplexMatrix& R) -> ComplexMatrix { return lu->solve(R); };
  };
  scene.dynamics = supplied;
  scene.f = {};  // sources by lag weights would need a convolution of all lags
  return scene;
}

// Set-up of a scene with many states: each rank solves at its share of the nodes, and has the weights of all of them
// and the same fit by poles. At most eight calls, one for each window of lags and for each set of nodes of a fit, are
// each divided to within one node.
TEST(SlabBackend, DividesTheSetUpOfLargeScenes) {
  constexpr int calls = 8;
  struct SetUp {
    LagTable weights;
    double error_of_fit = 0;
    int solves_for_weights = 0, solves_for_fit = 0;
  };
  const auto set_up = [](Backend& backend) {
    std::atomic<int> prepared = 0;
    const Scene scene = counting_heat(prepared);
    const DiscreteProblem p = discretise(scene, backend, 256), of_fit = discretise(scene, backend, 256);
    SetUp made;
    made.weights = *lag_table_of(*make_time_operator(p)->weights(256, nullptr, 0));
    made.solves_for_weights = prepared;
    made.error_of_fit = fit_pole_model(of_fit, {}).error;
    made.solves_for_fit = prepared - made.solves_for_weights;
    return made;
  };
  const SetUp alone = set_up(*make_cpu_backend(1));
  ASSERT_TRUE(std::isfinite(alone.error_of_fit));
  for (const int ranks : {2, 3})
    on_threads(ranks, [&](Communicator& communicator) {
      const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
      const SetUp found = set_up(*backend);
      EXPECT_EQ(found.weights.W, alone.weights.W);
      EXPECT_EQ(found.weights.S, alone.weights.S);
      EXPECT_EQ(found.error_of_fit, alone.error_of_fit);
      EXPECT_LE(ranks * (found.solves_for_weights - calls), alone.solves_for_weights);
      EXPECT_LE(ranks * (found.solves_for_fit - calls), alone.solves_for_fit);
      EXPECT_GT(alone.solves_for_fit, 4 * calls) << "otherwise the counts above say little";
    });
}

TEST(SlabBackend, RefusesWhatDoesNotSplit) {
  const Scene scene = make_scene("dlcp-small", {});
  const auto refused = [&](const Options& options, int ranks) {
    return refusal([&] {
      on_threads(ranks, [&](Communicator& communicator) {
        const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
        solve(scene, *backend, options);
      });
    });
  };
  EXPECT_EQ(
      refused(options_for(Method::march, 256), 2),
      "method: found march on 2 ranks, and it does not split over time; choose multigrid, contour or dual, or run "
      "it on one rank");
  EXPECT_EQ(refused(options_for(Method::contour, 2), 3), "ranks: found 3 for 2 steps; use fewer ranks, or more steps");
  EXPECT_EQ(refused(options_for(Method::automatic, 256), 2).rfind("method: found auto on 2 ranks", 0), 0u);
  Options timed = options_for(Method::contour, 256);
  timed.max_seconds = 1;
  EXPECT_EQ(refused(timed, 2), "max_seconds: is given on 2 ranks, whose clocks differ; leave it out");
  Options by_fft = options_for(Method::contour, 512);
  by_fft.tuning.convolution = ConvolutionChoice::fft;
  EXPECT_EQ(refused(by_fft, 2),
            "ranks: found 2 for a convolution over lag weights, which does not split over time; run it on one rank");
}

}  // namespace
}  // namespace bromwich
