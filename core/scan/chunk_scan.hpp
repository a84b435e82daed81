#pragma once
// Newton's method on the states between chunks of time.
//
// The steps of a march are divided into C chunks. Unknown are the states s_c before the chunks, s_0 is given. A pass
//
//   1. marches every chunk from its s_c, all side by side: to the end e_c, with the derivative D_c = de_c/ds_c, the
//      product of the derivatives of its steps with their active sets held;
//   2. corrects the states by a scan of affine maps,
//
//          delta_{c+1} = (e_c - s_{c+1}) + D_c delta_c,   delta_0 = 0,   s_c <- s_c + delta_c.
//
// Where no delta is left the rows of all chunks are those of the march. s_0 is exact, so that e_0 is, and after k
// passes the first k chunks are those of the march for good. Where the active sets are those of the march the maps are
// affine, and the next correction is exact: near the solution the method ends at once, and it is quadratic where steps
// are smooth. A chunk whose state has settled is not marched again.
//
// delta is of rounding, and a chunk has settled, if it is below the rounding of its march, or if all steps before it
// had the same active sets in two passes: they had affine maps then, whose correction leaves nothing but rounding.
// Sizes are those of the chunks before, which are right once these have settled.
//
// Where perturbations grow from chunk to chunk, as at impacts, the exact chunks at the front advance by one a pass and
// the others do not come closer. That is seen after a few passes, and the rest is marched chunk by chunk from the
// front, where a chunk whose state is met is not marched again.

#include "../base/threads.hpp"
#include "../base/types.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>
#include <vector>

namespace bromwich {

class ChunkMarcher;

struct ScanPlan {
  const HostThreads* threads = nullptr;
  ChunkMarcher* device = nullptr;          ///< marches the chunks (core/seam/chunk_march.hpp); null: the threads do
  Index chunks = 0;                        ///< 0: by the threads and the steps
  bool by_pieces = true;                   ///< steps may be evaluated by affine pieces (piece_march.hpp)
  bool coarse_start = true;                ///< the first states are those of a march of few steps; false: all are x0
  std::function<bool()> interrupted = {};  ///< polled by the calling thread
};

/// The number of chunks of a plan for so many steps.
Index chunks_of(const ScanPlan&, Index steps);
/// Rows at which they begin, and the last row: chunks + 1 values from 0 to `steps`.
std::vector<Index> first_rows(Index chunks, Index steps);

struct ChunkEnd {
  Vector s;                ///< the state behind the last step
  Vector size;             ///< largest |s_i| behind its steps
  Matrix D;                ///< its derivative by the state before the first step; empty unless asked for
  std::uint64_t sets = 0;  ///< a hash of the active sets of all steps
  bool complete = false;   ///< false: a step has no solution, and s is not known
};

/// The chunks of one march.
class Chunks {
 public:
  virtual ~Chunks() = default;
  virtual Index count() const = 0;
  /// Marches a chunk and keeps its rows. Concurrent for different chunks.
  virtual ChunkEnd march(Index chunk, const Vector& start, bool with_derivative) = 0;
  /// What a step needs to know of the steps before it beside their state comes from the last marches of the chunks
  /// before its own. True: this chunk takes other steps with it than its last march.
  virtual bool hand_over(Index /*chunk*/) { return false; }
};

/// The request to stop, polled by the thread that made the object and seen by all.
class SharedStop {
 public:
  explicit SharedStop(std::function<bool()> asked) : asked_(std::move(asked)) {}
  bool operator()() const {
    if (asked_ && std::this_thread::get_id() == owner_ && asked_()) stopped_ = true;
    return stopped_;
  }

 private:
  std::function<bool()> asked_;
  std::thread::id owner_ = std::this_thread::get_id();
  mutable std::atomic<bool> stopped_ = false;
};

struct ScanReport {
  Index chunks = 0, passes = 0;
  Index in_turn = 0;   ///< chunks that were marched one after another in the end
  Index stopped = -1;  ///< the first chunk with a step that has no solution; those behind it are not known
  bool interrupted = false;
  bool by_pieces = false;       ///< steps were evaluated by affine pieces (piece_march.hpp)
  double seconds = 0;           ///< of the passes by pieces, without copies of sources and rows
  std::vector<double> history;  ///< largest delta of each pass, relative to the sizes of the states
};

/// `starts`: the first states, s_0 among them. `longest`: steps of the longest chunk.
ScanReport solve_chunks(Chunks&, std::vector<Vector> starts, Index longest, const HostThreads&, const SharedStop&);

}  // namespace bromwich
