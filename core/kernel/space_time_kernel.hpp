#pragma once

#include "../seam/backend.hpp"

#include <memory>

namespace bromwich {

/// Sweeps of the iteration in turn; v <- K y comes between them, and before the first and behind the last as said here.
struct SweepOrder {
  int count = 1;
  bool before = false, behind = false;
};

/// v = K * y: S (modal convolution) S for the Kronecker sum, one convolution otherwise. Counts its seconds.
class SpaceTimeKernel {
 public:
  SpaceTimeKernel(Backend&, std::unique_ptr<Convolution>, bool modal, Index rows, Index n);

  void apply(const Array& y, Array& v, Index first);
  /// The same for y = R y_fine on the grid with half the steps, y_fine what `fine` was last applied to: its modes are
  /// known.
  void apply_injected(const SpaceTimeKernel& fine, const Array& y_fine, Array& y, Array& v);
  /// For a Kronecker sum, where the modes of what `fine` was last applied to are all that is needed.
  void apply_injected_modes(const SpaceTimeKernel& fine, Array& v);
  /// Whether `sweep` is there for batches of this plan.
  bool sweeps(const LcpBatch&) const;
  /// y <- SOL(M + D, r + v - D y) from row 1 on, `count` times, with v <- K y between them and where `order` says so.
  /// If there is none before the first, v has to be K y, and the kernel applied to a y with this row 0 last. v is K y
  /// then if there is one behind the last, otherwise as it was: from sweep to sweep it stays in modes.
  void sweep(LcpBatch&, const Array& r, Array& y, Array& v, SweepOrder order);
  /// r <- known + what x0 adds by itself, for a Kronecker sum: the recurrence of the kernel with x0 in its start, by D
  /// of Convolution::start_from, applied to `zero`. `known` may be r. `keep`: the plan for it is kept for the next x0.
  /// False, and r as it was, where the recurrence cannot carry it.
  bool add_start(const ModalRecurrence&, const Array& D, const Array& zero, const Array& known, Array& r, bool keep);
  std::size_t bytes() const;

  double transform_seconds = 0, convolution_seconds = 0;

 private:
  Backend& backend_;
  std::unique_ptr<Convolution> convolution_, start_;
  std::unique_ptr<SineTransform> sine_;
  std::unique_ptr<Array> y_modes_, v_modes_;
};

}  // namespace bromwich
