// Pieces of a transfer through a ring of slots (kernels/piece_relay.hpp), with a simulated slow transfer.

#include "kernels/piece_relay.hpp"
#include "kernels/unpacking.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
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

// ---- Values in segments.

// The packed form of rows, by its definition.
struct Packed {
  std::vector<double> values;
  std::vector<std::uint64_t> masks;
  std::size_t others = 0;
};

Packed packed(const std::vector<double>& all) {
  const std::size_t segments = cuda::segments_of(all.size());
  Packed p{std::vector<double>(segments * cuda::segment_values, NAN),
           std::vector<std::uint64_t>(segments * cuda::segment_masks, 0)};
  for (std::size_t s = 0; s < segments; ++s) {
    std::size_t next = s * cuda::segment_values;
    for (std::size_t i = s * cuda::segment_values; i < std::min(all.size(), (s + 1) * cuda::segment_values); ++i) {
      if (std::bit_cast<std::uint64_t>(all[i]) == 0) continue;
      p.values[next++] = all[i];
      p.masks[i / 64] |= std::uint64_t(1) << i % 64;
      ++p.others;
    }
  }
  return p;
}

// Rows shorter and longer than a segment, without zeros, with all, with some; -0 and NaN are no zeros. Targets begin
// anywhere in a line of a cache, and what lies beyond the rows stays as it is.
TEST(Unpacking, GivesTheRowsBack) {
  for (const auto [step, cols, rows] :
       {std::array<std::size_t, 3>{8, 7, 1}, {64, 64, 4}, {72, 65, 130}, {1032, 1025, 9}})
    for (const int zeros : {0, 1, 2})
      for (const std::size_t shift : {0, 1, 5}) {
        std::vector<double> all(step * rows, 0.0);
        for (std::size_t j = 0; j < rows; ++j)
          for (std::size_t i = 0; i < cols; ++i)
            all[j * step + i] = zeros == 2 || (zeros == 1 && (i / 40 + j) % 3 > 0) ? 0 : double(j * step + i + 1);
        if (zeros == 1) all[0] = -0.0, all[(rows - 1) * step] = NAN;
        const Packed p = packed(all);
        std::vector<double> target(shift + cols * rows + 8, -7.0);
        const std::size_t segments = cuda::segments_of(all.size()), middle = segments / 2;
        std::size_t others = 0;
        for (const auto& [first, last] : {std::pair(middle, segments), std::pair(std::size_t(0), middle)})
          others += cuda::unpack_segments(p.values.data(), p.masks.data(), first, last, {step, cols, rows},
                                          target.data() + shift);
        EXPECT_EQ(others, p.others);
        for (std::size_t j = 0; j < rows; ++j)
          for (std::size_t i = 0; i < cols; ++i)
            ASSERT_EQ(std::bit_cast<std::uint64_t>(target[shift + j * cols + i]),
                      std::bit_cast<std::uint64_t>(all[j * step + i]))
                << step << " " << zeros << " " << shift << " " << j << " " << i;
        for (std::size_t i = 0; i < target.size(); ++i) {
          const bool beside = i < shift || i >= shift + cols * rows;
          ASSERT_TRUE(!beside || target[i] == -7.0) << i << " " << target[i];
        }
      }
}

}  // namespace
}  // namespace bromwich
