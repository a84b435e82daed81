#pragma once

#include "../seam/backend.hpp"

#include <memory>

namespace bromwich {

/// Consecutive sweeps of the iteration. v <- K y runs between them, and before the first or after the last if set here.
struct SweepOrder {
  int count = 1;
  bool before = false, behind = false;
};

/// v = K * y: V (modal convolution) V^T for a Kronecker sum, one convolution otherwise. Measures its seconds.
class SpaceTimeKernel {
 public:
  /// `face`: empty: K is not applied in modes.
  SpaceTimeKernel(Backend&, std::unique_ptr<Convolution>, const FaceBasis& face, Index rows, Index n);

  void apply(const Array& y, Array& v, Index first);
  /// The same for y = R y_fine on the grid with half the steps, where `fine` was last applied to y_fine; its modes are
  /// reused.
  void apply_injected(const SpaceTimeKernel& fine, const Array& y_fine, Array& y, Array& v);
  /// For a Kronecker sum; needs only the modes of the array that `fine` was last applied to.
  void apply_injected_modes(const SpaceTimeKernel& fine, Array& v);
  /// Whether Backend::record can take it.
  bool recorded() const { return convolution_->recorded(); }
  /// Whether `sweep` can be used with this batch.
  bool sweeps(const LcpBatch&) const;
  /// y <- SOL(M + D, r + v - D y) from row 1 on, `count` times, with v <- K y between them and where `order` says so.
  /// Without `before`, v must be K y, and the kernel must last have been applied to a y with the same row 0. With
  /// `behind`, v is K y afterwards; otherwise v is unchanged, as it stays in modes between sweeps.
  void sweep(LcpBatch&, const Array& r, Array& y, Array& v, SweepOrder order);
  /// r <- known + response to x0 for a Kronecker sum, by the recurrence of the kernel with x0 in its start (D of
  /// Convolution::start_from), applied to the array `zero`. `known` may be r. `keep`: keeps the plan for the next x0.
  /// Returns false and leaves r unchanged if the recurrence cannot represent x0.
  bool add_start(const ModalRecurrence&, const Array& D, const Array& zero, const Array& known, Array& r, bool keep);
  std::size_t bytes() const;

  double transform_seconds = 0, convolution_seconds = 0;

 private:
  Backend& backend_;
  std::unique_ptr<Convolution> convolution_, start_;
  FaceTransforms face_;  ///< empty: K is not applied in modes
  std::unique_ptr<Array> y_modes_, v_modes_;
};

}  // namespace bromwich
