#include "ranks/combined_states.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

// What a ModalState reads of a recurrence.
ModalRecurrence exponentials(RowMatrix decay, RowMatrix output) {
  ModalRecurrence r;
  r.w0 = Vector::Zero(decay.cols());
  r.start = RowMatrix::Zero(decay.rows(), decay.cols());
  r.decay = std::move(decay);
  r.output = std::move(output);
  return r;
}

RowMatrix with_row(const RowMatrix& rows, const Eigen::RowVectorXd& last) {
  RowMatrix all(rows.rows() + 1, rows.cols());
  all << rows, last;
  return all;
}

Eigen::RowVectorXd same(double value, Index n) { return Eigen::RowVectorXd::Constant(n, value); }

}  // namespace

StageState::StageState(const StageRecurrence& r) {
  const Index n = r.modes();
  for (int a = 0; a < 2; ++a) {
    by_stage_.emplace_back(exponentials(with_row(r.decay, same(0, n)), with_row(r.output[a], r.w1[a].transpose())));
    input_[a] = with_row(r.input[a], same(a == 1 ? 1 : 0, n));
  }
}

void StageState::advance(HostRows& y, Index rows, const HostThreads& threads, Eigen::Ref<Vector> z) const {
  z.setZero();
  for (int b = 0; b < 2; ++b) {
    Vector driven = Vector::Zero(size());
    HostRows stage = y.stage(b);
    by_stage_[0].advance(stage, rows / 2, threads, driven);
    z += Eigen::Map<const Vector>(input_[b].data(), size()).cwiseProduct(driven);
  }
}

Index StageState::add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads& threads, HostRows& v) const {
  Index last = 0;
  for (int a = 0; a < 2; ++a) {
    HostRows stage = v.stage(a);
    last = std::max(last, by_stage_[std::size_t(a)].add(z, rows / 2, threads, stage));
  }
  return 2 * last;
}

SharedState::SharedState(const LagTable& table)
    : exponentials_(table.exponentials),
      modal_(exponentials(exponentials_->decay.replicate(1, table.inputs),
                          RowMatrix::Ones(exponentials_->decay.size(), table.inputs))) {}

void SharedState::advance(HostRows& y, Index rows, const HostThreads& threads, Eigen::Ref<Vector> z) const {
  modal_.advance(y, rows, threads, z);
}

Index SharedState::add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads& threads, HostRows& v) const {
  const Index K = exponentials_->decay.size(), n = size() / K;
  Vector seen(size());
  for (Index k = 0; k < K; ++k)
    seen.segment(k * n, n).noalias() =
        Eigen::Map<const RowMatrix>(exponentials_->output.row(k).data(), n, n) * z.segment(k * n, n);
  return modal_.add(seen, rows, threads, v);
}

}  // namespace bromwich
