// Contract of the operations on rows (core/seam/slab_operations.hpp): slabs that follow each other, held against one
// array that has them all.

#include "catalogue/catalogue.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/row_ranks.hpp"

#include <tuple>

namespace bromwich {
namespace {

using reference::Random;

std::vector<BackendCase> cases_with_rows() {
  std::vector<BackendCase> cases{{"rows", make_row_backend}};
  if (!cuda_devices().empty()) cases.push_back({"cuda", [] { return make_cuda_backend(make_cpu_backend(2)); }});
  return cases;
}

class BackendSlabs : public BackendTest {
 protected:
  const SlabOperations& slabs() const { return backend->fused().slabs; }

  // v of all rows, each slab by a plan of its own, with `start` before row 1 if that is not empty.
  RowMatrix divided(const ModalRecurrence& r, const std::vector<Index>& ends, const RowMatrix& y, Index first = 0) {
    const int ranks = int(ends.size()) - 1;
    std::vector<std::unique_ptr<CarriedConvolution>> plans;
    std::vector<std::unique_ptr<Array>> in, out, left;
    RowMatrix all_few;
    for (int rank = 0; rank < ranks; ++rank) {
      const Index begin = ends[std::size_t(rank)], rows = ends[std::size_t(rank) + 1] - begin + 1;
      plans.push_back(slabs().carried_convolution(r, ends, rank));
      in.push_back(device(y.middleRows(begin, rows)));
      out.push_back(backend->array(rows, y.cols()));
      left.push_back(backend->array(1, plans.back()->state));
      const Index lasting = plans.back()->lasting;
      EXPECT_EQ(lasting, plans.front()->lasting) << "ranks differ";
      EXPECT_EQ(plans.back()->state, plans.front()->state) << "ranks differ";
      all_few.resize(ranks, lasting);
      const auto few = lasting > 0 ? backend->array(1, lasting) : nullptr;
      plans.back()->leave(*in.back(), *left.back(), few.get());
      few_.push_back(few ? host(*few) : RowMatrix(1, 0));
    }
    for (int rank = 0; rank < ranks; ++rank) all_few.row(rank) = few_[std::size_t(rank)].row(0);
    few_.clear();
    const auto all = all_few.cols() > 0 ? device(all_few) : nullptr;
    RowMatrix v = RowMatrix::Zero(y.rows(), y.cols());
    for (int rank = 0; rank < ranks; ++rank) {
      const std::size_t r_ = std::size_t(rank);
      if (rank > 0) plans[r_]->begin(*left[r_ - 1], all.get());
      plans[r_]->apply(*in[r_], *out[r_], 0);
      if (first > 0) plans[r_]->apply(*in[r_], *out[r_], std::min(first, out[r_]->rows() - 1));
      v.middleRows(ends[r_] + 1, ends[r_ + 1] - ends[r_]) = host(*out[r_]).bottomRows(ends[r_ + 1] - ends[r_]);
    }
    return v;
  }

 private:
  std::vector<RowMatrix> few_;
};

INSTANTIATE_TEST_SUITE_P(Contract, BackendSlabs, testing::ValuesIn(cases_with_rows()), backend_case_name);

/// Memories of all rows, of some hundred and of a few, in blocks of eight modes.
ModalRecurrence some_modes(Index n, Index K) {
  Random random{std::uint32_t(n + K)};
  ModalRecurrence r;
  r.decay = random.matrix(K, n).cwiseAbs();
  const double slowest[] = {1, 0.9, 0.2};
  for (Index l = 0; l < n; ++l) {
    r.decay(l % K, l) = 1;
    r.decay.col(l) *= slowest[l / 8 % 3];
  }
  r.output = random.matrix(K, n) / double(K);
  r.start = random.matrix(K, n);
  r.w0 = random.vector(n);
  r.w1 = random.vector(n);
  r.s1 = random.vector(n);
  return r;
}

// Sums of at most J terms of size 2 and, with x0, of K; each row rounds once for each term and exponential.
double tolerance(Index rows, Index K) { return epsilon * double(rows + 16) * double(rows) * double(2 + K); }

TEST_P(BackendSlabs, ADividedConvolutionIsThatOfAllRows) {
  const auto cpu = make_cpu_backend(1);
  for (const auto& [n, K] : {std::pair<Index, Index>{1, 1}, {11, 5}, {75, 24}, {40, 70}})
    for (const std::vector<Index>& ends : std::vector<std::vector<Index>>{{0, 1, 2},
                                                                          {0, 64, 128},
                                                                          {0, 500, 1003},
                                                                          {0, 100, 337, 600},
                                                                          {0, 85, 170, 256, 300},
                                                                          {0, 16, 17, 400, 416}})
      for (const bool with_x0 : {false, true}) {
        ModalRecurrence r = some_modes(n, K);
        if (with_x0) r.initial = Random(3).matrix(K, n);
        const Index rows = ends.back() + 1;
        const RowMatrix y = Random(std::uint32_t(rows)).matrix(rows, n);
        const auto plan = cpu->convolution(Recurrence(r), rows);
        const auto in = cpu->array(rows, n), out = cpu->array(rows, n);
        cpu->upload(y, *in);
        plan->apply(*in, *out, 0);
        RowMatrix expected;
        cpu->download(*out, expected);
        for (const Index first : {0, 40})
          EXPECT_LE(bromwich::distance(divided(r, ends, y, first), expected), tolerance(rows, K))
              << n << ' ' << K << ' ' << ends.size() - 1 << " ranks, " << rows << " rows, x0 " << with_x0;
      }
}

// Modes of a face, whose groups keep the rates that they need, with whole slabs and uneven ones.
TEST_P(BackendSlabs, ModesOfAFace) {
  const Scene scene = make_scene("signorini3d", {{"Q", 31}});
  const Index J = 256;
  const auto cpu = make_cpu_backend(2);
  const DiscreteProblem p = discretise(scene, *cpu, J);
  const SharedWeights weights = make_time_operator(p)->weights(J, nullptr, 0);
  const ModalRecurrence& r = *modal_recurrence_of(*weights);
  const RowMatrix y = Random(5).matrix(J + 1, r.modes());
  const auto in = device(y), out = backend->array(J + 1, r.modes());
  backend->convolution(weights_ref(*std::get_if<Recurrence>(weights.get())), J + 1)->apply(*in, *out, 0);
  const RowMatrix expected = host(*out);
  for (const std::vector<Index>& ends : {std::vector<Index>{0, 128, 256}, {0, 85, 170, 256}})
    EXPECT_LE(bromwich::distance(divided(r, ends, y), expected),
              tolerance(J + 1, r.exponentials()) * r.w0.cwiseAbs().maxCoeff())
        << ends.size() - 1 << " ranks";
}

// More groups of 32 modes than a device has room for warps.
TEST_P(BackendSlabs, ModesForAllWarps) {
  const Index n = 34005, K = 11;
  const ModalRecurrence r = some_modes(n, K);
  for (const std::vector<Index>& ends : {std::vector<Index>{0, 17, 70}, {0, 20, 41, 70}}) {
    const Index rows = ends.back() + 1;
    const RowMatrix y = Random(8).matrix(rows, n);
    const auto cpu = make_cpu_backend(2);
    const auto plan = cpu->convolution(Recurrence(r), rows);
    const auto in = cpu->array(rows, n), out = cpu->array(rows, n);
    cpu->upload(y, *in);
    plan->apply(*in, *out, 0);
    RowMatrix expected;
    cpu->download(*out, expected);
    EXPECT_LE(bromwich::distance(divided(r, ends, y), expected), tolerance(rows, K));
  }
}

TEST_P(BackendSlabs, RowsMove) {
  for (const Index n : {1, 7, 40}) {
    const RowMatrix a = Random(1).matrix(9, n), b = Random(2).matrix(6, n);
    const auto from = device(a), to = device(b);
    RowMatrix expected = b;
    slabs().move_rows(from.get(), 1, 3, *to, 2, 3);
    for (Index i = 0; i < 3; ++i) expected.row(2 + i) = a.row(1 + 3 * i);
    EXPECT_EQ(host(*to), expected);
    slabs().move_rows(from.get(), 4, 1, *to, 0, 2);
    expected.topRows(2) = a.middleRows(4, 2);
    slabs().move_rows(nullptr, 0, 1, *to, 5, 1);
    expected.row(5).setZero();
    EXPECT_EQ(host(*to), expected);
    RowMatrix some(2, n);
    slabs().download_rows(*to, 1, 2, some.data());
    EXPECT_EQ(some, expected.middleRows(1, 2));
    some *= 2;
    slabs().upload_rows(some.data(), *to, 3, 2);
    expected.middleRows(3, 2) = some;
    EXPECT_EQ(host(*to), expected);
  }
}

TEST_P(BackendSlabs, RowsAreInterpolatedInTheMiddleOfAGrid) {
  for (const Index n : {1, 7, 40})
    for (const bool with_old : {false, true}) {
      const Index ratio = 3;
      const RowMatrix coarse = Random(1).matrix(9, n), old = Random(2).matrix(9, n), fine = Random(3).matrix(25, n);
      const auto C = device(coarse), O = device(old), whole = device(fine);
      backend->interpolate(*C, with_old ? O.get() : nullptr, *whole);
      for (const auto& [first, rows] : {std::pair<Index, Index>{0, 25}, {4, 11}, {24, 1}, {7, 18}}) {
        const auto part = device(fine.middleRows(first, rows));
        slabs().interpolate_rows(*C, with_old ? O.get() : nullptr, ratio, first, *part);
        EXPECT_LE(bromwich::distance(host(*part), host(*whole).middleRows(first, rows)), 16 * epsilon * 4)
            << n << ' ' << first;
      }
    }
}

}  // namespace
}  // namespace bromwich
