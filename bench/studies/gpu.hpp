#pragma once
// The parts of `bench gpu`: operations of the CUDA backend, and whole solves compared with those of the CPU.

#include "bench/studies/study.hpp"
#include "core/solve/kept_solver.hpp"
#include "kernels/ceilings.hpp"

#include <memory>

namespace bromwich::app {

/// Seconds of one sweep of the functional iteration on signorini and of its operations, several times each.
struct Sweep {
  std::vector<double> whole, recorded, lcp, transform, scan, fft, upload, download;
  Index exponentials = 0;
};
Sweep measure_sweep(const Scene& scene, Backend& backend, Index J, int repeats);
Json sweep_row(double Q, Index J, const Sweep&, const CudaCeilings&);

/// y >= 0 that vanishes half of the time, smooth in both directions, and q = w - M y with w = 0 where y > 0.
struct Known {
  RowMatrix y, q;
};
Known known_solution(const LcpMatrix& M, Index rows);

/// Sine transforms in both forms: rows of the report, and its table.
std::string measure_transforms(bool quick, const CudaCeilings&, BenchReport&);
/// Batches of dense problems by size, matrix and start (gpu_problems.cpp).
std::string measure_small_problems(Backend& backend, int repeats, bool quick, const CudaCeilings&, BenchReport&);

/// Whole solves on one grid by the CUDA backend and by the CPU with one core and with all cores, interleaved.
struct GpuContestant {
  std::string name;
  Backend* backend;
  Options options;
  Result result = {};  ///< of the warm-up, arrays dropped
  Deviation error = {};
  Samples samples = {};
  std::vector<double> sweeps = {};
  /// Of the same scene again, with what the solve before has prepared; null: each solve prepares all.
  std::shared_ptr<KeptSolver> kept = nullptr;
};
std::vector<GpuContestant> measure_solves(const Scene& scene, Index J, Backend& cuda, Backend& one, Backend& all,
                                          int repeats, bool quick);
Json solve_row(double Q, const GpuContestant&);

}  // namespace bromwich::app
