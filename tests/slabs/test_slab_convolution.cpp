// One convolution whose rows are divided among ranks, held against one rank that has them all.

#include "core/slabs/slab_convolution.hpp"

#include "core/slabs/slab_backend.hpp"
#include "core/slabs/slab_states.hpp"
#include "core/slabs/slabs.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/reference_backend.hpp"
#include "tests/support/row_ranks.hpp"
#include "tests/support/run.hpp"
#include "tests/support/thread_ranks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

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
  r.decay(0, 0) = 1;                                                          // one without end
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

RowMatrix convolved(Backend& backend, const Recurrence& recurrence, const RowMatrix& y, const RowMatrix& later,
                    Index first) {
  const auto in = backend.array(y.rows(), y.cols()), out = backend.array(y.rows(), y.cols());
  const auto plan = backend.convolution(recurrence, y.rows());
  backend.upload(y, *in);
  plan->apply(*in, *out, 0);
  backend.upload(later, *in);
  plan->apply(*in, *out, first);
  RowMatrix v;
  backend.download(*out, v);
  return v;
}

// Rounding of sums of 500 terms up to 1, of which those without end grow with the rows.
constexpr double same_sum = 1e-12;

TEST(SlabConvolution, IsThatOfOneRank) {
  const Index J = 500, n = 11;
  const RowMatrix y = Random(19).matrix(J + 1, n);
  for (const Recurrence& recurrence :
       {Recurrence(some_modes(5, n)), Recurrence(short_modes(5, n)), Recurrence(some_state(4, n))})
    for (const Index first : {0, 60, 260, 440}) {
      RowMatrix later = y;
      later.bottomRows(J + 1 - first) = Random(20).matrix(J + 1 - first, n);
      const auto cpu = make_cpu_backend(1);
      const RowMatrix expected = convolved(*cpu, recurrence, y, later, first);
      for (const Divide divide :
           {Divide(on_host), Divide(elsewhere), Divide(elsewhere_by_host), Divide(make_backend_over_rows)})
        for (const int ranks : {1, 2, 3, 4, 7})
          on_threads(ranks, [&](Communicator& communicator) {
            const auto backend = divide(communicator);
            const RowMatrix found = convolved(*backend, recurrence, y, later, first);
            EXPECT_LE(distance(found, expected), same_sum * expected.cwiseAbs().maxCoeff()) << ranks << " ranks";
          });
    }
}

// Without the carries the result is another one, by far: the test above sees them.
TEST(SlabConvolution, CarriesMatter) {
  const Recurrence recurrence = some_modes(5, 11);
  const auto cpu = make_cpu_backend(1);
  RowMatrix y = Random(19).matrix(501, 11);
  const RowMatrix whole = convolved(*cpu, recurrence, y, y, 0);
  y.topRows(251).setZero();
  EXPECT_GT(distance(convolved(*cpu, recurrence, y, y, 0).bottomRows(200), whole.bottomRows(200)), 1e-2);
}

TEST(SlabConvolution, SendsWhatTheFormulaSays) {
  const Index J = 512, n = 11, K = 5, m = 4;
  const ModalRecurrence modes = some_modes(K, n);
  const DenseRecurrence state = some_state(m, n);
  const RowMatrix y = Random(19).matrix(J + 1, n);
  for (const int ranks : {1, 2, 3, 4, 7}) {
    const auto bytes_of = [&](const Recurrence& recurrence) {
      std::size_t shifted = 0, gathered = 0;
      for (const Traffic& sent : on_threads(ranks, [&](Communicator& communicator) {
             const auto backend = make_slab_backend(make_cpu_backend(1), communicator);
             const auto in = backend->array(J + 1, n), out = backend->array(J + 1, n);
             const auto plan = backend->convolution(recurrence, J + 1);
             backend->upload(y, *in);
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
    std::size_t lasting = 0;
    for (Index i = 0; i < modes.decay.size(); ++i)
      lasting += std::pow(modes.decay.data()[i], double(shortest)) > forgotten;
    ASSERT_GT(lasting, 0u);
    ASSERT_LT(lasting, std::size_t(K * n));
    const auto [shifted, gathered] = bytes_of(modes);
    EXPECT_EQ(shifted, 8 * (R - 1) * std::size_t(n * (K + 1)));
    EXPECT_EQ(gathered, ranks > 2 ? 8 * R * (R - 1) * lasting : 0);
    const auto [of_state, to_all] = bytes_of(state);
    EXPECT_EQ(of_state, 8 * (R - 1) * std::size_t(m));
    EXPECT_EQ(to_all, ranks > 2 ? 8 * R * (R - 1) * std::size_t(m) : 0) << "0.999 outlives any slab here";
  }
}

}  // namespace
}  // namespace bromwich
