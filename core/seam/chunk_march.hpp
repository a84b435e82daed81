#pragma once
// Marches of one dense scene in chunks of time, all side by side, with the derivatives of the chunks, and the scan that
// corrects the states between them (core/scan/chunk_scan.hpp): on a backend, in its threads. Steps are those of
// core/host/affine_pieces.hpp, which has the letters. A backend with threads for it is a ChunkMarcher; the host has it
// as well.

#include "../base/plan.hpp"
#include "../base/threads.hpp"
#include "../base/types.hpp"
#include "array.hpp"

#include <memory>
#include <vector>

namespace bromwich {

/// The maps of one kind of step, not padded. Stages: u = 2 n, and implicit Euler has zeros in the first half.
struct ChunkStep {
  RowMatrix see, decay, drive;  ///< u x m, m x m, m x u
  RowMatrix shown;              ///< m x u; continuous y
  Vector q, f, d;               ///< u, m, m
  RowMatrix of_q, of_f, of_d;   ///< u x p, m x p, m x p
  Vector unit;                  ///< u
  double h = 0;
};

/// A piece of the solutions of one kind. Without equations K is empty.
struct ChunkPiece {
  RowMatrix V, K, P;
  unsigned active = 0, equal = 0;
  double rounding = 0;  ///< relative, up to which a value counts as zero
};

struct ChunkMarchProblem {
  Index m = 0, n = 0;
  bool continuous = true;
  std::vector<ChunkStep> steps;        ///< `kinds` of them, and behind them those of implicit Euler
  Index kinds = 1;                     ///< at most 128
  std::vector<unsigned char> kind_of;  ///< of each row; empty: all 0
  RowMatrix sources;                   ///< J+1 rows of p numbers
  bool substitutes_euler = false;
  unsigned rigid = 0;
  RowMatrix moved;     ///< B, m x n; stages
  Vector s0, regular;  ///< m and n: before the first step
  unsigned touching = 0;
  bool wants_impulse = false;

  Index unknowns() const { return continuous ? n : 2 * n; }
  Index rows() const { return sources.rows(); }
};

/// A problem of a step that no known piece solves: its row and kind, and q (u).
struct ChunkMiss {
  Index row = 0, kind = 0;
  Vector q;
};

/// What is left after a correction of the states.
struct ChunkCorrection {
  Index open = 0;      ///< chunks that have not settled
  double largest = 0;  ///< delta of them, relative to the sizes of the states
  bool finite = true;
};

class ChunkMarch : public Plan {
 public:
  static constexpr Index most_pieces = 256;  ///< of a kind

  /// So many chunks, all of which begin at s0.
  virtual void begin(Index chunks) = 0;
  virtual void add(Index kind, const ChunkPiece&) = 0;
  /// Marches the chunks that have not settled, or those of the last misses. Some of the misses: these chunks have no
  /// end yet.
  virtual std::vector<ChunkMiss> pass(bool missed_only) = 0;
  virtual ChunkCorrection correct() = 0;

  /// Rows of all steps; row 0 is not written. `impulse` is null unless it is wanted. In the memory of the backend.
  virtual const Array& x() const = 0;
  virtual const Array& y() const = 0;
  virtual const Array* impulse() const = 0;
  /// Copies one of these arrays to the host.
  virtual void download(const Array& from, RowMatrix& to) const = 0;
  /// Steps of the last marches that implicit Euler took.
  virtual Index jumps() const = 0;
};

/// Whether the sizes of the problem have threads: at most 16 states, 16 unknowns of a step, 8 numbers of sources,
/// and kinds of steps whose pieces fill 128 MiB.
bool fits_chunk_march(const ChunkMarchProblem&);
/// An optional operation of a backend, which few files need: such a backend is one of these, too.
class ChunkMarcher {
 public:
  virtual ~ChunkMarcher() = default;
  /// Null for sizes that it does not take.
  virtual std::unique_ptr<ChunkMarch> chunk_march(const ChunkMarchProblem&) = 0;
};

/// On the host. Refers to the problem.
std::unique_ptr<ChunkMarch> chunk_march_on_host(const HostThreads&, const ChunkMarchProblem&);

}  // namespace bromwich
