#pragma once
// The kernel that takes the steps of a modal march: its tables, its state between launches, and its launch.

#include "kernels/device.hpp"

namespace bromwich::cuda {

/// A = R (M + W_0) C, row by row; S: sine matrix. Tables of the recurrence are K x n with the mode index contiguous.
struct StepTables {
  const double *A, *sine, *row_scale, *column_scale;
  const double *decay, *output;
  const double *lag1, *w0;  ///< lag1 = w1 + Σ_k C_k, the full weight W_1
  int n, exponentials;
};

/// State kept between steps, launches and runs.
struct StepState {
  double* start_transform;  ///< G for the start set of the last run; with `kept_steps`, of each step, one after another
  double* transform;        ///< G between launches; used throughout if it does not fit into shared memory
  unsigned char *start_active, *active;
  int *start_updates, *updates;  ///< pivots since each was formed from A
  double *z, *known;             ///< K x n and n, for the next step
  unsigned long long* mail;      ///< 2 x n messages, cleared before each launch
  double* rows;                  ///< 2 x n x 2n: rows of G for the next pivots
  /// 0, or all steps of a short march: each begins with the active set that it had in the last run, not with that of
  /// the step before, from which it differs by more.
  int kept_steps;
  long transform_size;  ///< values from one kept G to the next
};

/// Arrays with `rows` rows, `step` values apart.
struct StepArrays {
  const double *r, *drive;    ///< drive in modes, or null
  double *y, *input, *known;  ///< in modes; input: S y; known: v_j without W_0 y_j
  int rows, step;
};

/// Steps first .. last-1. `begins`: from y_0. `goes_on`: another launch follows.
struct StepSpan {
  int first, last;
  bool begins, goes_on;
};

/// Written to the host by the device.
struct StepOutcome {
  long long sweeps;
  int reached;    ///< first step that is not done
  int fallbacks;  ///< steps that needed pivots one by one
  int drifted;    ///< a row failed the check after the march
};

/// Launch configuration of one size.
class StepKernel {
 public:
  /// Precondition: 1 <= n.
  StepKernel(const Device&, Index n, Index exponentials);

  /// Whether all blocks can be resident at once.
  bool fits() const { return kernel_ != nullptr; }
  /// Whether G stays in shared memory during a launch.
  bool resident() const { return resident_; }
  /// Number of values of G, with the rows of all blocks.
  std::size_t transform_size() const { return std::size_t(4 * own_ * blocks_ * n_); }

  /// Forms G of the empty set for all blocks.
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
