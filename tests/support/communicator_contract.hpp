#pragma once
// What every communicator has to do, whatever its transport. All ranks call it; it returns what was wrong on this one.

#include "core/seam/backend.hpp"
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

/// The same for one whose rows travel as arrays of `local`.
inline std::vector<std::string> faults_of_rows(Communicator& ranks, Backend& local) {
  std::vector<std::string> faults;
  const int rank = ranks.rank(), size = ranks.size();
  const auto check = [&](bool holds, const char* what) {
    if (!holds) faults.push_back("rank " + std::to_string(rank) + " of " + std::to_string(size) + ": " + what);
  };
  check(ranks.moves_rows(), "rows do not travel");
  for (const Index cols : {1, 3, 40}) {
    const auto values_of = [cols](int r) {
      RowMatrix values(5, cols);
      for (Index i = 0; i < values.size(); ++i) values.data()[i] = 1000. * r + double(i);
      return values;
    };
    const auto array = local.array(5, cols), other = local.array(5, cols);
    const Traffic before = ranks.sent();
    local.upload(values_of(rank), *array);
    local.upload(RowMatrix::Constant(5, cols, -1), *other);
    ranks.shift({{array.get(), 4, other.get(), 0, 1}, {array.get(), 1, other.get(), 2, 2}});
    RowMatrix expected = RowMatrix::Constant(5, cols, -1), found;
    if (rank > 0) {
      expected.row(0) = values_of(rank - 1).row(4);
      expected.middleRows(2, 2) = values_of(rank - 1).middleRows(1, 2);
    }
    local.download(*other, found);
    check(found == expected, "shift does not give the rows of the rank before");
    check(ranks.sent().shifted - before.shifted == (rank + 1 < size ? 24 * std::size_t(cols) : 0),
          "shifted rows are not counted as sent to the next rank");

    const auto one = local.array(1, cols), all = local.array(size, cols);
    local.upload(values_of(rank).row(2), *one);
    ranks.gather(*one, *all);
    local.download(*all, found);
    for (int r = 0; r < size; ++r)
      check(found.row(r) == values_of(r).row(2), "gather does not give all rows in the order of the ranks");
    // Rank r gives r rows; then one rank gives all.
    std::vector<Index> ends(1, 0);
    for (int r = 0; r < size; ++r) ends.push_back(ends.back() + r);
    for (int root = -1; root < size; ++root) {
      if (root >= 0)
        for (int r = 0; r <= size; ++r) ends[std::size_t(r)] = r > root ? 3 : 0;
      const auto many = local.array(1 + ends.back(), cols);
      local.upload(RowMatrix::Constant(1 + ends.back(), cols, rank), *many);
      ranks.gather(*many, ends);
      local.download(*many, found);
      expected = RowMatrix::Constant(1 + ends.back(), cols, rank);
      for (int r = 0; r < size; ++r)
        expected.middleRows(ends[std::size_t(r)], ends[std::size_t(r) + 1] - ends[std::size_t(r)]).setConstant(r);
      check(found == expected, "gather does not give the rows of each rank");
    }
  }
  return faults;
}

}  // namespace bromwich
