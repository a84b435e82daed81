#pragma once
// Newton's method on the states between chunks of time (chunk_scan.hpp) for scenes of few states and constraints, whose
// steps are evaluated by the affine pieces of their solutions: on the threads of the host, or on those of a device,
// where all chunks are marched side by side. Both have the steps of `march`.

#include "../seam/chunk_march.hpp"
#include "chunk_scan.hpp"
#include "solution_pieces.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

/// A march, and what finds its pieces: for each entry of steps.steps the problem that it solves.
struct PieceMarchProblem {
  ChunkMarchProblem steps;
  std::vector<PieceProblem> problems;
};

/// Its rows, in the memory of `march`.
struct PieceMarch {
  std::unique_ptr<PieceMarchProblem> problem;  ///< which the march refers to
  std::unique_ptr<ChunkMarch> march;
  ScanReport report;
};

/// Null march: the sizes do not fit, some step is outside all pieces (it has no solution, or one that is none of its
/// class), or the passes lead nowhere. The report says how many passes were in vain.
PieceMarch march_by_pieces(PieceMarchProblem, const ScanPlan&, const SharedStop&);

}  // namespace bromwich
