#pragma once
// Checkpoints: what is needed to continue a run from a time point.

#include "core/base/types.hpp"
#include "files/result_file.hpp"

#include <string>

namespace bromwich {

struct Checkpoint {
  std::string run;    ///< identifies the run: the files of its result have it too
  std::string scene;  ///< fingerprint of scene and options: a restart must have the same
  Index row = 0;      ///< time point, of `steps`
  Index steps = 0;
  double t = 0;
  Vector x;      ///< the whole state at t
  Vector y;      ///< at t, from the step that ends there
  Facts totals;  ///< what the facts of the result have summed up so far
};

/// Replaces the file by a complete one: the old one stays until the new one is on the disk.
void write_checkpoint(const FileTarget&, const Checkpoint&);

/// Throws Error if the file is no checkpoint.
Checkpoint read_checkpoint(const FileTarget&);

}  // namespace bromwich
