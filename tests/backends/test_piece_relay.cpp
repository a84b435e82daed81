// Pieces of a transfer through a ring of slots (kernels/piece_relay.hpp), with a simulated slow transfer.

#include "kernels/piece_relay.hpp"

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace bromwich {
namespace {

struct Relayed {
  std::vector<std::size_t> target;  ///< [piece][part]: number of the piece found in its slot, + 1
  std::string failure;
};

// Slots hold the number of their piece. A piece arrives after `latency` polls. `failing` never starts.
Relayed relayed(std::size_t pieces, std::size_t parts, std::size_t slots, int threads, int latency,
                std::size_t failing = ~std::size_t(0)) {
  std::vector<std::size_t> ring(slots, 0);
  std::vector<int> asked(pieces, 0);
  Relayed result{std::vector<std::size_t>(pieces * parts, 0), ""};
  PieceRelay relay(
      pieces, parts, slots,
      [&](std::size_t piece) {
        if (piece == failing) throw std::runtime_error("piece " + std::to_string(piece));
        ring[piece % slots] = piece + 1;
      },
      [&](std::size_t piece) { return ++asked[piece] > latency; },
      [&](std::size_t piece, std::size_t part) { result.target[piece * parts + part] += ring[piece % slots]; });
  relay.advance();
  {
    std::vector<std::jthread> others;
    for (int t = 1; t < threads; ++t) others.emplace_back([&relay] { relay.work(); });
    relay.work();
  }
  try {
    if (relay.failure()) std::rethrow_exception(relay.failure());
  } catch (const std::exception& e) {
    result.failure = e.what();
  }
  return result;
}

// Every part is taken out once, while its slot holds its piece.
TEST(PieceRelay, TakesOutEachPartOnceFromItsOwnPiece) {
  for (const std::size_t pieces : {0, 1, 2, 7, 64})
    for (const std::size_t slots : {1, 3, 8})
      for (const int threads : {1, 2, 5})
        for (const int latency : {0, 3}) {
          const std::size_t parts = 4;
          const Relayed found = relayed(pieces, parts, slots, threads, latency);
          EXPECT_EQ(found.failure, "");
          for (std::size_t i = 0; i < found.target.size(); ++i)
            ASSERT_EQ(found.target[i], i / parts + 1) << pieces << " pieces, " << slots << " slots, " << threads;
        }
}

TEST(PieceRelay, EndsForAllThreadsWhereAPieceFails) {
  for (const int threads : {1, 4}) {
    const Relayed found = relayed(20, 2, 3, threads, 1, 11);
    EXPECT_EQ(found.failure, "piece 11");
    for (std::size_t i = 0; i < found.target.size(); ++i)
      EXPECT_TRUE(found.target[i] == i / 2 + 1 || (i / 2 > 8 && found.target[i] == 0)) << i;
  }
}

}  // namespace
}  // namespace bromwich
