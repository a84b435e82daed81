#pragma once
// Ranks: processes that compute one solve together, each with a part of the time points (docs/slabs.md). All of them
// make the same calls in the same order. Rank 0 comes first in time.

#include "backend.hpp"
#include "types.hpp"

#include <cstddef>
#include <memory>
#include <vector>

namespace bromwich {

class Array;

/// Bytes that a rank has sent, by operation; a value that goes to several ranks counts once for each.
struct Traffic {
  std::size_t shifted = 0, gathered = 0, compared = 0, broadcast = 0;

  std::size_t all() const { return shifted + gathered + compared + broadcast; }
};

/// `count` rows of `from` that go to the next rank, and where the rows of the rank before go, as many, in `to`.
struct RowShift {
  const Array* from;
  Index from_row;
  Array* to;
  Index to_row, count;
};

/// The operations that core needs of a job of several ranks. Calls wait for the ranks that they need.
class Communicator {
 public:
  /// `rank` of `size` ranks, counted from 0.
  Communicator(int rank, int size) : rank_(rank), size_(size) {}
  virtual ~Communicator() = default;
  Communicator(const Communicator&) = delete;
  Communicator& operator=(const Communicator&) = delete;

  int rank() const { return rank_; }
  int size() const { return size_; }

  /// Sends `right` to the next rank and receives `left`, of the same length there, from the one before. The last rank
  /// sends nothing; the first one receives nothing and keeps its `left`.
  void shift(const Vector& right, Vector& left);
  /// Row r holds the values of rank r. All ranks give as many.
  RowMatrix gather(const Vector& values);
  /// The largest value over the ranks, place by place; NaN where a rank has one.
  void maximum(Vector& values);
  /// The values of rank `root` on all ranks.
  void broadcast(double* values, Index count, int root);

  /// Steps of a time grid for each rank from which on it pays to divide them: a coarser grid costs the same messages
  /// for half the work. 16 steps are as much work as a message between processes of one machine, whose length grows
  /// with that of the rows (bench/results/scale.json).
  virtual Index fewest_steps() const { return 16; }

  /// Whether rows of arrays travel from device to device, in the order of the stream of their backend: the calls below
  /// return before that. They need it; where it is false, rows go through the host.
  virtual bool moves_rows() const { return false; }
  /// Like `shift`, of all these rows. The last rank sends nothing, and the first one keeps its rows.
  void shift(const std::vector<RowShift>&);
  /// Row r of `all` <- the one row of `values` of rank r.
  void gather(const Array& values, Array& all);
  /// Rows ends[r] .. ends[r + 1] - 1 of rank r on all ranks; ends has size + 1 entries.
  void gather(Array& rows, const std::vector<Index>& ends);

  /// Of this rank, since it was made.
  const Traffic& sent() const { return sent_; }

 private:
  virtual void do_shift(const Vector& right, Vector& left) = 0;
  virtual void do_gather(const Vector& values, RowMatrix& all) = 0;
  virtual void do_maximum(Vector& values) = 0;  ///< without NaN
  virtual void do_broadcast(double* values, Index count, int root) = 0;
  virtual void do_shift_rows(const std::vector<RowShift>&) {}
  virtual void do_gather_rows(const Array&, Array&) {}
  virtual void do_gather_rows(Array&, const std::vector<Index>&) {}

  const int rank_, size_;
  Traffic sent_;
};

/// The only rank of a job.
class OneRank final : public Communicator {
 public:
  OneRank() : Communicator(0, 1) {}

 private:
  void do_shift(const Vector&, Vector&) override {}
  void do_gather(const Vector& values, RowMatrix& all) override { all.row(0) = values.transpose(); }
  void do_maximum(Vector&) override {}
  void do_broadcast(double*, Index, int) override {}
};

/// A backend whose arrays are divided into slabs of time, one for each rank. All ranks run the same solve: what reaches
/// the host is the same on all of them, up to whole results. `local` computes the slab of this rank. The communicator
/// must outlive the backend.
std::unique_ptr<Backend> make_slab_backend(std::unique_ptr<Backend> local, Communicator&);
/// The backend keeps the communicator, which ends before `local`.
std::unique_ptr<Backend> make_slab_backend(std::unique_ptr<Backend> local, std::unique_ptr<Communicator>);

}  // namespace bromwich
