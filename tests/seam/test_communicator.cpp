#include "core/seam/communicator.hpp"

#include "cpu/cpu_backend.hpp"
#include "tests/support/communicator_contract.hpp"
#include "tests/support/row_ranks.hpp"
#include "tests/support/thread_ranks.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

TEST(Communicator, OneRankTalksToItself) {
  OneRank alone;
  EXPECT_EQ(faults_of(alone), std::vector<std::string>{});
  EXPECT_EQ(alone.sent().all(), 0u);
}

TEST(Communicator, ThreadsAreRanks) {
  for (const int size : {1, 2, 3, 4, 7})
    on_threads(size, [](Communicator& ranks) { EXPECT_EQ(faults_of(ranks), std::vector<std::string>{}); });
}

TEST(Communicator, RowsTravelAsArrays) {
  for (const int size : {1, 2, 3, 4})
    on_threads(size, [](Communicator& ranks) {
      const auto local = make_row_backend();
      const auto rows = make_row_rank(ranks);
      EXPECT_EQ(faults_of(*rows), std::vector<std::string>{});
      EXPECT_EQ(faults_of_rows(*rows, *local), std::vector<std::string>{});
    });
}

// The contract sees a communicator that drops the first value of a shift.
TEST(Communicator, TheContractFindsAFault) {
  class Broken final : public Communicator {
   public:
    explicit Broken(Communicator& inner) : Communicator(inner.rank(), inner.size()), inner_(inner) {}

   private:
    void do_shift(const Vector& right, Vector& left) override {
      inner_.shift(right, left);
      if (left.size() > 0 && rank() > 0) left[0] += 1;
    }
    void do_gather(const Vector& values, RowMatrix& all) override { all = inner_.gather(values); }
    void do_maximum(Vector& values) override { inner_.maximum(values); }
    void do_broadcast(double* values, Index count, int root) override { inner_.broadcast(values, count, root); }
    Communicator& inner_;
  };
  on_threads(2, [](Communicator& ranks) {
    Broken broken(ranks);
    EXPECT_EQ(faults_of(broken).empty(), ranks.rank() == 0);
  });
}

TEST(Communicator, ABackendOfItsOwnHasOneRank) { EXPECT_EQ(make_cpu_backend(1)->ranks(), 1); }

}  // namespace
}  // namespace bromwich
