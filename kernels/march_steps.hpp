#pragma once
// The kernel that takes the steps of a modal march: its tables, its state between launches, and its launch.

#include "kernels/device.hpp"

namespace bromwich::cuda {

/// A = R (M + W_0) C, row by row; S the sine matrix; tables of the recurrence are K x n with the mode index contiguous.
struct StepTables {
  const double *A, *sine, *row_scale, *column_scale;
  const double *decay, *output;
  const double *lag1, *w0;  ///< lag1 = w1 + Σ_k C_k, the whole weight W_1
  int n, exponentials;
};

/// What lives between steps, launches and runs.
struct StepState {
  double* start_transform;  ///< G for the start set of the last run
  double* transform;        ///< G between launches; where it does not fit into shared memory, always
  unsigned char *start_active, *active;
  int *start_updates, *updates;  ///< exchanges since each was formed from A
  double *z, *known;             ///< K x n and n: of the next step
  unsigned long long* mail;      ///< 2 x n messages, cleared before each launch
  double* rows;                  ///< 2 x n x 2n: rows of G that are about to be exchanged
};

/// Arrays of `rows` rows, `step` values apart.
struct StepArrays {
  const double *r, *drive;    ///< drive in modes, or null
  double *y, *input, *known;  ///< input: S y; known: what v_j holds without W_0 y_j, both in modes
  int rows, step;
};

/// Steps first .. last-1. `begins`: from y_0; `goes_on`: another launch follows.
struct StepSpan {
  int first, last;
  bool begins, goes_on;
};

/// Written to the host by the device.
struct StepOutcome {
  long long sweeps;
  int reached;    ///< the first step not done
  int fallbacks;  ///< steps that needed exchanges one by one
  int drifted;    ///< a row did not pass the check afterwards
};

/// How one size is launched.
class StepKernel {
 public:
  /// Precondition: 1 <= n.
  StepKernel(const Device&, Index n, Index exponentials);

  /// All blocks can be on the device at once.
  bool fits() const { return kernel_ != nullptr; }
  /// G stays in shared memory during a launch.
  bool resident() const { return resident_; }
  /// Values of G with the rows of all blocks.
  std::size_t transform_size() const { return std::size_t(4 * own_ * blocks_ * n_); }

  /// G of the empty set for all blocks.
  void form(const StepTables&, double* transform) const;
  void launch(StepTables, StepState, StepArrays, StepSpan, StepOutcome*) const;

 private:
  template <int own, int columns, bool resident>
  bool choose();

  const Device& device_;
  Index n_, exponentials_;
  int own_ = 0, blocks_ = 0, threads_ = 0;
  std::size_t shared_ = 0;
  bool resident_ = false;
  const void* kernel_ = nullptr;
};

}  // namespace bromwich::cuda
