#pragma once
// Collects rows until they fill chunks of a file: a chunk that is written twice takes twice the space.

#include "files/result_file.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

class BatchedFile : public ResultFile {
 public:
  void append(const ResultRows& rows) final {
    Index first = 0;
    const Index count = rows.t.size();
    if (pending_ > 0) first = collect(rows, 0, std::min(room(), count));
    // Rows from here on start a chunk, or the file was continued inside of one.
    while (pending_ == 0 && count - first >= room()) {
      const Index most = std::max(chunk_rows(), flush_rows() / chunk_rows() * chunk_rows());
      const Index whole = (count - first - room()) / chunk_rows() * chunk_rows() + room();
      const Index block = std::min(whole, room() + most - chunk_rows());
      write_block(rows, first, block);
      first += block;
    }
    collect(rows, first, count - first);
  }

  void flush() final {
    if (pending_ == 0) return;
    const Index count = std::exchange(pending_, 0);
    write_block({t_.head(count), y_.topRows(count), w_.topRows(count), x_.topRows(count)}, 0, count);
  }

  Index rows() const final { return written_ + pending_; }

 protected:
  virtual Index chunk_rows() const = 0;  ///< of the largest array
  virtual Index flush_rows() const = 0;  ///< that are written at once
  /// Writes and flushes rows after the `written` ones.
  virtual void write(const ResultRows&, Index written) = 0;

  void continue_after(Index rows) { written_ = rows; }

 private:
  /// Rows until the next chunk starts.
  Index room() const { return chunk_rows() - (written_ + pending_) % chunk_rows(); }

  void write_block(const ResultRows& rows, Index first, Index count) {
    write({rows.t.segment(first, count), part(rows.y, first, count), part(rows.w, first, count),
           part(rows.x, first, count)},
          written_);
    written_ += count;
  }

  /// No rows of an array without columns.
  static Eigen::Ref<const RowMatrix> part(const Eigen::Ref<const RowMatrix>& values, Index first, Index count) {
    return values.cols() > 0 ? values.middleRows(first, count) : values.middleRows(0, 0);
  }

  Index collect(const ResultRows& rows, Index first, Index count) {
    if (count <= 0) return first;
    if (t_.size() == 0) t_.resize(chunk_rows());
    t_.segment(pending_, count) = rows.t.segment(first, count);
    for (const auto& [into, values] : {std::pair(&y_, &rows.y), {&w_, &rows.w}, {&x_, &rows.x}}) {
      if (into->rows() == 0) into->resize(chunk_rows(), values->cols());
      if (values->cols() > 0) into->middleRows(pending_, count) = values->middleRows(first, count);
    }
    pending_ += count;
    if (pending_ == chunk_rows() || room() == chunk_rows()) flush();
    return first + count;
  }

  Vector t_;
  RowMatrix y_, w_, x_;  ///< rows that wait
  Index pending_ = 0, written_ = 0;
};

}  // namespace bromwich
