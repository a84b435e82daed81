#pragma once
// States in a slab of recurrences other than those of ranks/slab_states.hpp, by a ModalState and what stands
// before and behind it. The last y that lag 1 needs is one more exponential of theirs, which is forgotten after a step.

#include "slab_states.hpp"

#include <memory>

namespace bromwich {

/// Two stages in each step: z_j = E z_{j-1} + Σ_b G_b y_b,j is the sum of the states that each stage drives, and C_a z
/// is added to stage a. K + 1 exponentials for each of n modes. Rows are those of both stages.
class StageState {
 public:
  explicit StageState(const StageRecurrence&);

  Index size() const { return by_stage_[0].size(); }
  void start(const double*, Eigen::Ref<Vector> z) const { z.setZero(); }
  /// From a z that is 0.
  void advance(HostRows& y, Index rows, const HostThreads&, Eigen::Ref<Vector> z) const;
  Index add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads&, HostRows& v) const;
  std::vector<Index> lasting(Index rows) const { return by_stage_[0].lasting(rows / 2); }
  auto power(const std::vector<Index>& which, Index rows) const { return by_stage_[0].power(which, rows / 2); }

 private:
  std::vector<ModalState> by_stage_;  ///< C_a
  RowMatrix input_[2];
};

/// Lag weights with exponentials in common: z_k holds n values that all entries of C_k see.
class SharedState {
 public:
  explicit SharedState(const LagTable&);

  Index size() const { return modal_.size(); }
  void start(const double*, Eigen::Ref<Vector> z) const { z.setZero(); }
  void advance(HostRows& y, Index rows, const HostThreads&, Eigen::Ref<Vector> z) const;
  Index add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads&, HostRows& v) const;
  std::vector<Index> lasting(Index steps) const { return modal_.lasting(steps); }
  auto power(const std::vector<Index>& which, Index steps) const { return modal_.power(which, steps); }

 private:
  std::shared_ptr<const SharedExponentials> exponentials_;
  ModalState modal_;
};

}  // namespace bromwich
