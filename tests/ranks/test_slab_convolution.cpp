// One convolution whose rows are divided among ranks, held against one rank that has them all.

#include "ranks/slab_convolution.hpp"

#include "ranks/slab_backend.hpp"
#include "ranks/slab_states.hpp"
#include "ranks/slabs.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/reference_backend.hpp"
#include "tests/support/row_ranks.hpp"
#include "tests/support/run.hpp"
#include "tests/support/thread_ranks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <type_traits>
#include <utility>

namespace bromwich {
namespace {

using reference::Random;
using Divide = std::unique_ptr<Backend> (*)(Communicator&);

// Arrays of the host, arrays elsewhere that are copied as a whole, and arrays elsewhere whose rows travel by
// themselves.
std::unique_ptr<Backend> on_host(Communicator& ranks) { return make_slab_backend(make_cpu_backend(1), ranks); }
std::unique_ptr<Backend> elsewhere(Communicator& ranks) { return make_slab_backend(make_reference_backend(), ranks); }
std::unique_ptr<Backend> elsewhere_by_host(Communicator& ranks) { return make_slab_backend(make_row_backend(), ranks); }

ModalRecurrence some_modes(Index K, Index n) {
  Random random{17};
  ModalRecurrence r;
  r.decay = random.matrix(K, n).cwiseAbs();
  r.decay.leftCols(n / 2) = r.decay.leftCols(n / 2).cwiseSqrt().cwiseSqrt();  // a long memory
  if (K > 0) r.decay(0, 0) = 1;                                               // one without end
  r.output = random.matrix(K, n);
  r.start = random.matrix(K, n);
  r.initial = random.matrix(K, n);
  r.w0 = random.vector(n);
  r.w1 = random.vector(n);
  r.s1 = random.vector(n);
  return r;
}

// Modes that forget within a slab: rows behind a first one go on without what other ranks have left.
ModalRecurrence short_modes(Index K, Index n) {
  ModalRecurrence r = some_modes(K, n);
  r.decay *= 0.4;
  return r;
}

DenseRecurrence some_state(Index m, Index n) {
  Random random{18};
  DenseRecurrence r;
  r.decay = random.matrix(m, m) / double(m);
  r.decay(0, 0) = 0.999;
  r.input = random.matrix(m, n);
  r.start = random.matrix(m, n);
  r.output = random.matrix(n, m);
  r.w0 = random.matrix(n, n);
  return r;
}

// Two stages in each step. The decays have both signs, as those of Radau IIA.
StageRecurrence some_stages(Index K, Index n) {
  Random random{21};
  StageRecurrence r;
  r.decay = random.matrix(K, n);
  r.decay(0, 0) = -0.999;
  for (int a = 0; a < 2; ++a) {
    r.input[a] = random.matrix(K, n);
    r.output[a] = random.matrix(K, n);
    r.w1[a] = random.vector(n);
    for (int b = 0; b < 2; ++b) r.w0[a][b] = random.vector(n);
  }
  return r;
}

// Lag weights for J steps whose entries have K exponentials in common, the last of which is a part of lag 1 alone.
LagTable some_entries(Index K, Index n, Index J) {
  Random random{22};
  auto shared = std::make_shared<SharedExponentials>();
  shared->decay = random.vector(K).cwiseAbs();
  shared->decay[0] = 0.999;
  shared->decay[K - 1] = 0;
  shared->output = random.matrix(K, n * n);
  LagTable table{n, n, false, RowMatrix::Zero(J + 1, n * n), RowMatrix::Zero(J + 1, n * n)};
  table.W.row(0) = random.matrix(1, n * n);
  for (Index d = 1; d <= J; ++d)
    for (Index k = 0; k < K; ++k) table.W.row(d) += std::pow(shared->decay[k], double(d - 1)) * shared->output.row(k);
  table.exponentials = shared;
  return table;
}

// The plan for so many rows.
using Plan = std::function<std::unique_ptr<Convolution>(Backend&, Index rows)>;
template <class Weights>
Plan plan_of(const Weights& weights) {
  if constexpr (std::is_same_v<Weights, StageRecurrence>)
    return [weights](Backend& backend, Index rows) { return backend.stage_convolution(weights, rows); };
  else
    return [weights](Backend& backend, Index rows) { return backend.convolution(weights, rows); };
}

RowMatrix convolved(Backend& backend, const Plan& make, const RowMatrix& y, const RowMatrix& later, Index first) {
  const auto in = backend.array(y.rows(), y.cols()), out = backend.array(y.rows(), y.cols());
  const auto plan = make(backend, y.rows());
  backend.upload(y, *in);
  plan->apply(*in, *out, 0);
  backend.upload(later, *in);
  plan->apply(*in, *out, first);
  RowMatrix v;
  backend.download(*out, v);
  return v;
}

// Rounding of sums of 500 terms up to 1, of which those without end grow with the rows. Sums by FFT too.
constexpr double same_sum = 1e-12;

TEST(SlabConvolution, IsThatOfOneRank) {
  const Index J = 500, n = 11;
  const RowMatrix y = Random(19).matrix(J + 1, n);
  for (const Plan& plan : {plan_of(Recurrence(some_modes(5, n))), plan_of(Recurrence(short_modes(5, n))),
                           plan_of(Recurrence(some_state(4, n))), plan_of(some_stages(5, n)),
                           plan_of(Recurrence(some_modes(0, n))), plan_of(some_entries(4, n, J))})
    for (const Index first : {0, 60, 260, 440}) {
      RowMatrix later = y;
      later.bottomRows(J + 1 - first) = Random(20).matrix(J + 1 - first, n);
      const auto cpu = make_cpu_backend(1);
      const RowMatrix expected = convolved(*cpu, plan, y, later, first);
      for (const Divide divide :
           {Divide(on_host), Divide(elsewhere), Divide(elsewhere_by_host), Divide(make_backend_over_rows)})
        for (const int ranks : {1, 2, 3, 4, 7})
          on_threads(ranks, [&](Communicator& communicator) {
            const auto backend = divide(communicator);
            const RowMatrix found = convolved(*backend, plan, y, later, first);
            EXPECT_LE(distance(found, expected), same_sum * expected.cwiseAbs().maxCoeff()) << ranks << " ranks";
          });
    }
}

// Without the carries the result is another one, by far: the test above sees them.
TEST(SlabConvolution, CarriesMatter) {
  const auto cpu = make_cpu_backend(1);
  for (const Plan& plan :
       {plan_of(Recurrence(some_modes(5, 11))), plan_of(some_stages(5, 11)), plan_of(some_entries(4, 11, 500))}) {
    RowMatrix y = Random(19).matrix(501, 11);
    const RowMatrix whole = convolved(*cpu, plan, y, y, 0);
    y.topRows(251).setZero();
    EXPECT_GT(distance(convolved(*cpu, plan, y, y, 0).bottomRows(200), whole.bottomRows(200)), 1e-2);
  }
}

TEST(SlabConvolution, SendsWhatTheFormulaSays) {
  const Index J = 512, n = 11, K = 5, m = 4;
  const ModalRecurrence modes = some_modes(K, n);
  const DenseRecurrence state = some_state(m, n);
  const StageRecurrence stages = some_stages(K, n);
  const LagTable entries = some_entries(K, n, J);
  const RowMatrix y = Random(19).matrix(2 * J + 1, n);
  for (const int ranks : {1, 2, 3, 4, 7}) {
    const auto bytes_of = [&](const Plan& make, Index rows) {
      std::size_t shifted = 0, gathered = 0;
      for (const Traffic& sent : on_threads(ranks, [&](Communicator& communicator) {
             const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
             const auto in = backend->array(rows, n), out = backend->array(rows, n);
             const auto plan = make(*backend, rows);
             backend->upload(y.topRows(rows), *in);
             plan->apply(*in, *out, 0);
           })) {
        shifted += sent.shifted;
        gathered += sent.gathered;
        EXPECT_EQ(sent.all(), sent.shifted + sent.gathered) << "a convolution needs nothing else";
      }
      return std::pair(shifted, gathered);
    };
    Slabs slabs;
    on_threads(ranks, [&](Communicator& c) {
      if (c.rank() == 0) slabs = slabs_of(J + 1, c);
    });
    Index shortest = J;
    for (int r = 1; r + 1 < ranks && !slabs.whole(); ++r) shortest = std::min(shortest, slabs.count(r));
    const std::size_t R = std::size_t(ranks);
    const auto lasting_of = [&](const RowMatrix& decay, Index steps) {
      const Index count = (decay.array().abs().pow(double(steps)) > forgotten).count();
      EXPECT_GT(count, 0);
      EXPECT_LT(count, decay.size());
      return std::size_t(count);
    };
    const auto [shifted, gathered] = bytes_of(plan_of(Recurrence(modes)), J + 1);
    EXPECT_EQ(shifted, 8 * (R - 1) * std::size_t(n * (K + 1)));
    EXPECT_EQ(gathered, ranks > 2 ? 8 * R * (R - 1) * lasting_of(modes.decay, shortest) : 0);
    const auto [of_stages, of_stages_to_all] = bytes_of(plan_of(stages), 2 * J + 1);
    EXPECT_EQ(of_stages, 8 * (R - 1) * std::size_t(n * (K + 1)));
    EXPECT_EQ(of_stages_to_all, ranks > 2 ? 8 * R * (R - 1) * lasting_of(stages.decay, shortest) : 0);
    const auto [of_entries, of_entries_to_all] = bytes_of(plan_of(entries), J + 1);
    EXPECT_EQ(of_entries, 8 * (R - 1) * std::size_t(n * K)) << "the last of the K is what lag 1 needs of y";
    EXPECT_EQ(of_entries_to_all,
              ranks > 2 ? 8 * R * (R - 1) * std::size_t(n) * lasting_of(entries.exponentials->decay, shortest) : 0);
    const auto [of_state, to_all] = bytes_of(plan_of(Recurrence(state)), J + 1);
    EXPECT_EQ(of_state, 8 * (R - 1) * std::size_t(m));
    EXPECT_EQ(to_all, ranks > 2 ? 8 * R * (R - 1) * std::size_t(m) : 0) << "0.999 outlives any slab here";
  }
}

}  // namespace
}  // namespace bromwich
