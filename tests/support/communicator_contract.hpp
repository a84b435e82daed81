#pragma once
// What every communicator has to do, whatever its transport. All ranks call it; it returns what was wrong on this one.

#include "core/seam/communicator.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace bromwich {

inline std::vector<std::string> faults_of(Communicator& ranks) {
  std::vector<std::string> faults;
  const int rank = ranks.rank(), size = ranks.size();
  const auto check = [&](bool holds, const char* what) {
    if (!holds) faults.push_back("rank " + std::to_string(rank) + " of " + std::to_string(size) + ": " + what);
  };
  const auto values_of = [](int r, Index count) {
    return Vector(Vector::LinSpaced(count, 1000. * r, 1000. * r + double(count - 1)));
  };
  check(rank >= 0 && rank < size, "the rank is not one of them");

  for (const Index count : {Index(1), Index(7), Index(100000)}) {
    const Traffic before = ranks.sent();
    Vector left = Vector::Constant(count, -1);
    ranks.shift(values_of(rank, count), left);
    check(left == (rank == 0 ? Vector(Vector::Constant(count, -1)) : values_of(rank - 1, count)),
          "shift does not give the values of the rank before");
    check(ranks.sent().shifted - before.shifted == (rank + 1 < size ? 8 * std::size_t(count) : 0),
          "a shift is not counted as sent to the next rank");

    const RowMatrix all = ranks.gather(values_of(rank, count));
    bool same = all.rows() == size && all.cols() == count;
    for (int r = 0; same && r < size; ++r) same = all.row(r).transpose() == values_of(r, count);
    check(same, "gather does not give all values in the order of the ranks");
    check(ranks.sent().gathered - before.gathered == 8 * std::size_t(count) * std::size_t(size - 1),
          "gathered values are not counted once for each other rank");

    for (int root = 0; root < size; ++root) {
      Vector values = values_of(rank, count);
      ranks.broadcast(values.data(), count, root);
      check(values == values_of(root, count), "broadcast does not give the values of its root");
    }
    check(ranks.sent().broadcast - before.broadcast == 8 * std::size_t(count) * std::size_t(size - 1),
          "a broadcast is not counted once for each other rank");
  }

  Vector largest(4);
  largest << double(rank), -double(rank), -std::numeric_limits<double>::infinity(), 3;
  if (rank == size - 1) largest[3] = std::numeric_limits<double>::quiet_NaN();
  ranks.maximum(largest);
  check(largest[0] == double(size - 1) && largest[1] == 0, "maximum is not the largest value");
  check(largest[2] == -std::numeric_limits<double>::infinity(), "maximum of -inf is not -inf");
  check(std::isnan(largest[3]), "maximum loses the NaN of one rank");

  Vector none, nothing;
  ranks.shift(none, nothing);
  ranks.maximum(none);
  check(ranks.gather(none).size() == 0, "empty messages are not empty");
  return faults;
}

}  // namespace bromwich
