#pragma once
// Long runs in parts of time. Each part is solved from the state at the end of the one before; the state at its end,
// from time to time written as a checkpoint, is all that a restart needs.
//
// The discretisation is a map from x(t_j) to x(t_{j+1}), so parts give the result of one run, to rounding. The
// functional iteration and multigrid treat all time points of a part together, which ranks share: all ranks take the
// same parts, and the first one writes. A tolerance looks at the whole run and is refused.

#include "app/result_output.hpp"
#include "app/scene_choice.hpp"
#include "core/solve/solve.hpp"
#include "files/checkpoint.hpp"

#include <optional>
#include <string>

namespace bromwich::app {

struct PartsOptions {
  std::optional<OutputFile> checkpoint;  ///< file of the checkpoints; empty: none are written
  double seconds = 60;                   ///< between two checkpoints, at least
  std::optional<Checkpoint> from;        ///< of --restart
  std::string run;                       ///< see Checkpoint
  std::string scene;                     ///< fingerprint
};

/// Options of the run: method march for auto, all steps known. Throws Error for what cannot be done in parts, naming
/// `argument`.
void prepare_parts(const std::string& argument, const Scene&, Options&);

/// Reads the checkpoint of --restart. Throws Error if it is of another run than `parts.scene` says.
void read_restart(const std::string& file, PartsOptions& parts);

/// The row of the checkpoint, as the first one of a new file.
void append_start(const Scene&, const Checkpoint&, ResultOutput& out);

/// Solves; rows go to `out` (a growing file that begin() or resume() has opened, or null) as they are computed. The
/// arrays of the result are those of the last part, its counters and errors those of the run.
Result solve_in_parts(const Scene&, Backend&, const Options&, const PartsOptions&, ResultOutput* out);

}  // namespace bromwich::app
