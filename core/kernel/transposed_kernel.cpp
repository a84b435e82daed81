#include "core/kernel/transposed_kernel.hpp"

#include "core/base/error.hpp"
#include "core/kernel/pole_plans.hpp"
#include "core/kernel/transposed_start.hpp"

#include <string>
#include <tuple>
#include <utility>

namespace bromwich {

namespace {

using Block = Eigen::Map<const RowMatrix>;

// Outputs and inputs of K.
std::pair<Index, Index> shape(const Weights& weights) {
  if (const LagTable* table = lag_table_of(weights)) return {table->outputs, table->inputs};
  if (const ModalRecurrence* modal = modal_recurrence_of(weights)) return {modal->modes(), modal->modes()};
  if (const auto* poles = std::get_if<PoleRecurrence>(&weights)) return {poles->model->n, poles->model->n};
  const auto& dense = std::get<DenseRecurrence>(*recurrence_of(weights));
  return {dense.w0.rows(), dense.w0.cols()};
}

LagTable transposed_table(const LagTable& table) {
  if (table.modal)
    return {table.outputs, table.inputs, true, table.W, RowMatrix::Zero(table.S.rows(), table.S.cols()), table.face};
  LagTable result{table.inputs,
                  table.outputs,
                  false,
                  RowMatrix(table.W.rows(), table.W.cols()),
                  RowMatrix::Zero(table.S.rows(), table.S.cols()),
                  {}};
  for (Index d = 0; d < table.W.rows(); ++d)
    Eigen::Map<RowMatrix>(result.W.row(d).data(), table.inputs, table.outputs) =
        Block(table.W.row(d).data(), table.outputs, table.inputs).transpose();
  return result;
}

// Row k becomes row J + 1 - k; row 0 becomes 0.
RowMatrix reversed(const RowMatrix& u) {
  RowMatrix result(u.rows(), u.cols());
  result.row(0).setZero();
  result.bottomRows(u.rows() - 1) = u.bottomRows(u.rows() - 1).colwise().reverse();
  return result;
}

}  // namespace

Weights transposed(const Weights& weights) {
  if (const LagTable* table = lag_table_of(weights)) return transposed_table(*table);
  if (const ModalRecurrence* modal = modal_recurrence_of(weights)) {
    ModalRecurrence same = *modal;  // V diag V^T is symmetric
    same.initial.resize(0, 0);
    return Recurrence(std::move(same));
  }
  const auto& dense = std::get<DenseRecurrence>(*recurrence_of(weights));
  return Recurrence(DenseRecurrence{dense.decay.transpose(), dense.output.transpose(),
                                    Matrix::Zero(dense.decay.rows(), dense.output.rows()), dense.input.transpose(),
                                    dense.w0.transpose()});
}

TransposedKernel::TransposedKernel(Backend& backend, SharedWeights weights, Index rows)
    : backend_(backend), weights_(std::move(weights)) {
  std::tie(outputs_, inputs_) = shape(*weights_);
  rows_ = rows;
  if (std::holds_alternative<PoleRecurrence>(*weights_)) return;
  const Weights backwards = transposed(*weights_);
  const LagTable* table = lag_table_of(backwards);
  auto convolution = table ? backend.convolution(*table, rows) : backend.convolution(*recurrence_of(backwards), rows);
  reversed_ = std::make_unique<SpaceTimeKernel>(backend, std::move(convolution), modal_face(*weights_), rows, inputs_);
  u_ = backend.array(rows, outputs_);
  v_ = backend.array(rows, inputs_);
}

Vector TransposedKernel::first_row(const RowMatrix& u) const { return transposed_start(backend_, *weights_, u); }

RowMatrix TransposedKernel::apply(const RowMatrix& u) {
  if (u.rows() != rows_ || u.cols() != outputs_)
    throw Error("u", "found " + std::to_string(u.rows()) + " x " + std::to_string(u.cols()),
                "K^T takes " + std::to_string(rows_) + " x " + std::to_string(outputs_));
  if (const auto* poles = std::get_if<PoleRecurrence>(weights_.get()))
    return transposed_convolution(backend_, *poles, u);
  backend_.upload(reversed(u), *u_);
  reversed_->apply(*u_, *v_, 0);
  RowMatrix v;
  backend_.download(*v_, v);
  v = reversed(v);
  v.row(0) = first_row(u).transpose();
  return v;
}

void TransposedKernel::apply(const Array& u, Array& v) {
  RowMatrix values;
  backend_.download(u, values);
  backend_.upload(apply(values), v);
}

std::size_t TransposedKernel::bytes() const { return reversed_ ? reversed_->bytes() + u_->bytes() + v_->bytes() : 0; }

}  // namespace bromwich
