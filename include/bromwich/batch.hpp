#pragma once
// Many scenes of one structure, each with a result and a status of its own:
//
//     E_k x' = A_k x + B_k y + f_k(t),   0 <= y  ⊥  w = N_k x + M_k y + g_k(t) >= 0,   x(0) = x0_k,   k = 0 .. K-1.
//
// Scenes with the same dynamics and M share kernels and factorizations. Small dense scenes of them are stepped side by
// side, eight in the lanes of a vector; the others are solved by a Solver, one after the
// other or on several threads. A scene whose result needs further checks before it can be called solved is solved
// singly.

#include "solver.hpp"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

/// What the scenes share, and what each has of its own. A member with a batch axis has K entries; an empty one is that
/// of `common`.
struct Batch {
  Scene common;
  Index scenes = 1;                              ///< K
  std::vector<Matrix> A, B, N, M, E;             ///< K matrices each, of the shapes in `common`
  RowMatrix x0;                                  ///< K x m
  std::vector<TimeFunction> f, g;                ///< K functions each
  std::vector<std::vector<double>> breakpoints;  ///< K lists of times in [0, T]
  bool breakpoints_are_all = false;              ///< as in Scene, for f, g and breakpoints with a batch axis
  bool no_pulses = false;                        ///< likewise
  std::vector<Scene> own;     ///< K whole scenes; nothing else but `times` and `same_sources` is read then
  bool same_sources = false;  ///< f, g and breakpoints of `own` are those of the first one: they are sampled once
  /// Of the rows, increasing from 0 to T of the first scene; scenes with another T have them at the same parts of T.
  /// Empty: the time points of the grid. They are needed with a tolerance, where grids differ.
  std::vector<double> times;
  /// On a backend whose memory is not that of the host, y and x stay there (BatchResult::arrays). All states are
  /// recorded, or none.
  bool keep_on_backend = false;

  /// Throws Error that names the first member with a wrong number of entries or a wrong shape.
  void validate() const;
};

/// Scenes of equal m and n. Those whose `dynamics` are copies of one value share their preparation.
Batch batch_of(std::vector<Scene> scenes);

/// The scene of index k.
Scene scene_of(const Batch&, Index k);

class BatchArrays;

struct BatchResult {
  Index scenes = 0;
  Vector t;                         ///< times of the rows; scenes of a list may have other final times
  std::vector<Status> status;       ///< K
  std::vector<std::string> reason;  ///< K; one line where the status is not solved
  std::vector<std::string> warning;
  std::vector<Method> method;         ///< K; the one that gave the result
  std::vector<double> infeasible_at;  ///< K; NaN where there is no such time
  Vector residual;                    ///< K, as Result::residual
  RowMatrix y;                        ///< K rows() x n, scene after scene; NaN where there is no value
  RowMatrix w;                        ///< the same of w = N x + M y + g with Options::trace; otherwise empty
  RowMatrix x;                        ///< K rows() x recorded components
  std::vector<char> w_is_due;         ///< empty, or scenes whose w is still to be computed (batch/stopped_batch.hpp)
  std::vector<Index> x_components;
  std::shared_ptr<const BatchArrays> arrays;  ///< with Batch::keep_on_backend, in place of y, w and x
  Index in_lanes = 0;                         ///< scenes that were stepped side by side
  Index prepared = 0;                         ///< scenes that were solved by a Solver that other scenes have used
  double seconds = 0;                         ///< wall clock
  std::size_t bytes = 0;                      ///< of the arrays of this result

  Index rows() const { return t.size(); }  ///< of a scene: J+1, or the number of `times`
  /// The rows of scene k in y, w or x.
  Eigen::Block<const RowMatrix> of(const RowMatrix& all, Index k) const {
    return all.block(k * rows(), 0, all.size() > 0 ? rows() : 0, all.cols());
  }
  Index solved() const;
};

/// Returns a backend on the same machine as another one, with one thread of the host, for one user until it is
/// released.
using MakeBackend = std::function<std::shared_ptr<Backend>()>;

/// Solves every scene with the same options. Bad values of one scene (NaN in its x0, a class that its M does not have)
/// end only that scene, with status unsupported and the text of the Error as its reason. Throws Error for members of
/// wrong shape, bad options, and where the results exceed options.memory_limit: use solve_in_blocks. `progress` gets
/// the number of scenes done as `iteration` and K as `total`. With `another`, scenes that are not stepped in lanes are
/// solved by as many threads as the backend has, each with a backend that `another` has made. Sources and supplied
/// dynamics are then called from these threads, several at once. `progress` and `interrupted` are always called by the
/// thread that called solve_batch.
BatchResult solve_batch(const Batch&, Backend&, const Options& = {}, const MakeBackend& another = {});

/// Bytes of the result of `scenes` scenes and of what is held beside it.
double predicted_bytes(const Batch&, const Options&, Index scenes, int threads = 1);

/// The same in blocks that fit into options.memory_limit (0: 1 GB); `take` gets each block and the index of its first
/// scene, in order. Returns the number of blocks. Stops after an interrupted one.
Index solve_in_blocks(const Batch&, Backend&, const Options&,
                      const std::function<void(Index first, const BatchResult&)>& take,
                      const MakeBackend& another = {});

}  // namespace bromwich
