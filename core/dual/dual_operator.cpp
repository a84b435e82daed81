#include "core/dual/dual_operator.hpp"

#include "core/kernel/recurrence.hpp"
#include "core/lcp/entries.hpp"

#include <utility>

namespace bromwich {

EulerResponse::EulerResponse(TimeOperator& op) : op_(op), p_(op.problem()) {}

MarchData& EulerResponse::data() {
  if (!data_) data_ = op_.march_weights(Rule::implicit_euler, RecurrenceChoice::automatic);
  return *data_;
}

std::unique_ptr<SpaceTimeKernel> EulerResponse::make_kernel() {
  const Index rows = p_.J + 1, n = p_.scene.constraints();
  auto convolution = p_.backend.convolution(std::get<Recurrence>(*data().weights), rows);
  return std::make_unique<SpaceTimeKernel>(p_.backend, std::move(convolution), p_.face(), rows, n);
}

// A dense state is stepped without y. In modes, x0 is part of the recurrence, and f = B phi acts like y.
void EulerResponse::respond(const Changes& changes, Array& r) {
  Backend& backend = p_.backend;
  if (p_.small_state()) {
    backend.upload(dense_response(p_, Rule::implicit_euler), r);
  } else if (p_.scene.x0.isZero(0) && p_.f.size() == 0) {
    upload(backend, p_.g, r);
    responded_ = false;  // the data does not know this g
  } else {
    MarchData& given = data();
    op_.add_sources(Rule::implicit_euler, given, responded_ ? changes : Changes{});
    responded_ = true;
    upload(backend, given.r, r);
    add_rough_response(p_, r);
    const auto& weights = std::get<ModalRecurrence>(std::get<Recurrence>(*given.weights));
    if (weights.initial.size() > 0 || given.drive) {
      const Index rows = p_.J + 1, n = p_.scene.constraints();
      const auto input = backend.array(rows, n), v = backend.array(rows, n);
      if (given.drive) upload(backend, *given.drive, *input);
      make_kernel()->apply(*input, *v, 0);
      backend.add(r, 1, *v, r);
    }
  }
  backend.upload(p_.start.transpose(), r);  // row 0
}

// The part of x0 in the recurrence is left out: it is in r.
void EulerResponse::apply(const Array& y, Array& v) {
  if (!kernel_) {
    if (auto* weights = std::get_if<ModalRecurrence>(&std::get<Recurrence>(*data().weights))) {
      const RowMatrix initial = std::exchange(weights->initial, RowMatrix());
      kernel_ = make_kernel();
      weights->initial = initial;
    } else {
      kernel_ = make_kernel();
    }
  }
  kernel_->apply(y, v, 0);
}

std::size_t EulerResponse::bytes() const { return (kernel_ ? kernel_->bytes() : 0) + (data_ ? data_->bytes() : 0); }

RowMatrix times_rows(const LcpMatrix& P, const RowMatrix& rows) {
  if (const auto* dense = std::get_if<Matrix>(&P)) return rows * dense->transpose();
  if (const auto* sparse = sparse_of(P)) return rows * sparse->transpose();
  const auto& t = std::get<Tridiagonal>(P);
  const Index n = t.diagonal.size();
  RowMatrix product = rows * t.diagonal.asDiagonal();
  for (Index i = 0; i + 1 < n; ++i) {
    product.col(i) += t.upper[i] * rows.col(i + 1);
    product.col(i + 1) += t.lower[i + 1] * rows.col(i);
  }
  return product;
}

void dual_response(Backend& backend, const LcpMatrix& P, SpaceTimeKernel& kernel, const Array& r, Array& work,
                   Array& s) {
  kernel.apply(r, work, 0);
  if (is_zero(P)) {
    backend.add(work, -2, work, s);  // -work
    backend.upload(RowMatrix::Zero(1, s.cols()), s);
    return;
  }
  RowMatrix known, far;
  backend.download(r, known);
  backend.download(work, far);
  RowMatrix result = -(times_rows(P, known) + far);
  result.row(0).setZero();
  backend.upload(result, s);
}

}  // namespace bromwich
