#pragma once
// Rows for a dataset that compresses: HDF5 compresses chunks one after the other, here threads share them.

#include "core/base/threads.hpp"
#include "files/hdf5_file.hpp"

#include <vector>

namespace bromwich::hdf5 {

/// Appends rows of doubles to a growing_dataset. Rows that do not fill a chunk wait for the next ones.
class ChunkedRows {
 public:
  /// An empty dataset, which stays open as long as this object is used.
  ChunkedRows(File&, hid_t dataset);

  void append(File&, const double* values, Index rows, const HostThreads&);
  /// Writes the rows that wait. No others follow.
  void finish(File&);

 private:
  void write_chunks(File&, const double* values, Index chunks, const HostThreads&);

  hid_t dataset_;
  Index chunk_rows_ = 0, width_ = 1;  ///< width: values of a row
  bool whole_rows_ = true;            ///< chunks hold whole rows, as they are in memory
  Index written_ = 0;
  std::vector<double> waiting_;
};

}  // namespace bromwich::hdf5
