#include "core/kernel/space_time_kernel.hpp"

#include "core/base/timer.hpp"
#include "core/kernel/compression.hpp"

#include <utility>

namespace bromwich {

SpaceTimeKernel::SpaceTimeKernel(Backend& backend, std::unique_ptr<Convolution> convolution, const FaceBasis& face,
                                 Index rows, Index n)
    : backend_(backend), convolution_(std::move(convolution)) {
  if (face.empty()) return;
  face_ = backend.face_transforms(face, rows);
  y_modes_ = backend.array(rows, n);
  v_modes_ = backend.array(rows, n);
}

void SpaceTimeKernel::apply(const Array& y, Array& v, Index first) {
  Timer timer;
  if (!face_.to_modes) {
    convolution_->apply(y, v, first);
    convolution_seconds += timer.lap();
    return;
  }
  face_.to_modes->apply(y, nullptr, *y_modes_, first);
  transform_seconds += timer.lap();
  convolution_->apply(*y_modes_, *v_modes_, first);
  convolution_seconds += timer.lap();
  face_.to_points->apply(*v_modes_, nullptr, v, first);
  transform_seconds += timer.lap();
}

void SpaceTimeKernel::apply_injected(const SpaceTimeKernel& fine, const Array& y_fine, Array& y, Array& v) {
  if (face_.to_modes) return apply_injected_modes(fine, v);
  backend_.inject(y_fine, y);
  apply(y, v, 0);
}

void SpaceTimeKernel::apply_injected_modes(const SpaceTimeKernel& fine, Array& v) {
  Timer timer;
  backend_.inject(*fine.y_modes_, *y_modes_);
  convolution_->apply(*y_modes_, *v_modes_, 0);
  convolution_seconds += timer.lap();
  face_.to_points->apply(*v_modes_, nullptr, v, 0);
  transform_seconds += timer.lap();
}

bool SpaceTimeKernel::sweeps(const LcpBatch& lcp) const {
  return face_.to_modes && face_.are_one() && lcp.submit_in_modes;
}

// Between two convolutions the batch reads v and writes y in modes.
void SpaceTimeKernel::sweep(LcpBatch& lcp, const Array& r, Array& y, Array& v, SweepOrder order) {
  if (order.before) {
    face_.to_modes->apply(y, nullptr, *y_modes_, 0);
    convolution_->apply(*y_modes_, *v_modes_, 0);
  }
  bool in_modes = order.before;
  for (int i = 1; i <= order.count; ++i, in_modes = true) {
    const bool more = i < order.count || order.behind;
    lcp.submit_in_modes(*face_.to_modes, r, in_modes ? *v_modes_ : v, in_modes, y, more ? y_modes_.get() : nullptr, 1);
    if (more) convolution_->apply(*y_modes_, *v_modes_, 0);
  }
  if (order.behind) face_.to_points->apply(*v_modes_, nullptr, v, 0);
}

bool SpaceTimeKernel::add_start(const ModalRecurrence& recurrence, const Array& D, const Array& zero,
                                const Array& known, Array& r, bool keep) {
  if (start_ && start_->start_from) {
    start_->start_from(D);
  } else {
    RowMatrix values;
    backend_.download(D, values);
    auto with_x0 = started(recurrence, values, backend_);
    if (!with_x0) return false;
    start_ = backend_.convolution(Recurrence(std::move(*with_x0)), zero.rows());
  }
  start_->apply(zero, *v_modes_, 0);
  if (!keep) start_.reset();
  face_.to_points->apply(*v_modes_, &known, r, 0);
  return true;
}

std::size_t SpaceTimeKernel::bytes() const {
  return convolution_->bytes() + (start_ ? start_->bytes() : 0) +
         (face_.to_modes ? face_.bytes() + y_modes_->bytes() + v_modes_->bytes() : 0);
}

}  // namespace bromwich
