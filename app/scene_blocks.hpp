#pragma once
// Blocks of scenes of a sweep, and a folder of those that are solved: ranks deal out the blocks, and a run that was
// ended goes on with the others.

#include "batch/batch.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace bromwich::app {

/// Scenes that are solved together, in the form in which the file of results takes them.
struct SceneBlock {
  Index first = 0, count = 0;
  std::vector<std::string> status, reason, warning;  ///< one per scene
  std::string rows;                                  ///< of a CSV file
  Vector residual;    ///< of an HDF5 file: one per scene, NaN where there is none; likewise
  RowMatrix y, w, x;  ///< with the rows of each
  Index in_lanes = 0;
  double seconds_read = 0, seconds = 0;  ///< of the scenes, and of their solve
};

struct ArraySizes {
  Index rows, constraints, states;  ///< of one scene
};
/// The arrays of a block. `places`: of its scenes in the result; -1 for one without, whose values are NaN.
void keep_arrays(SceneBlock&, BatchResult, const std::vector<Index>& places, ArraySizes);

/// One file for each block, which is there as a whole or not at all.
class BlockFolder {
 public:
  /// `sweep` says what is solved, and how: blocks of another one are of no use.
  BlockFolder(std::filesystem::path folder, std::string sweep);

  /// By one rank, before all others use it: an empty folder, or with `again` the one of the run before. Throws Error,
  /// naming --restart, if that is none, or one of another sweep.
  void open(bool again) const;
  bool has(Index first) const;
  /// Throws Error if the block cannot be written.
  void save(const SceneBlock&) const;
  /// Throws Error if the block is not there.
  SceneBlock load(Index first) const;
  /// By one rank, at the end.
  void remove() const;
  const std::filesystem::path& place() const { return folder_; }

 private:
  std::filesystem::path name_of(Index first) const;

  std::filesystem::path folder_;
  std::string sweep_;
};

}  // namespace bromwich::app
