#include "core/kernel/weights.hpp"

#include "core/kernel/pole_plans.hpp"

#include <unsupported/Eigen/FFT>

#include <cmath>

namespace bromwich {

namespace {

// |S diag(w) S| 1. sin a sin b is a difference of cosines: entry (i, j) is c(i-j) - c(i+j) with
// c(d) = 1/(n+1) Σ_k w_k cos(pi k d/(n+1)), an even function of period 2(n+1).
Vector row_sums_in_modes(const Vector& w) {
  const Index n = w.size(), period = 2 * (n + 1);
  Vector padded = Vector::Zero(period);
  padded.segment(1, n) = w / double(n + 1);
  ComplexVector transformed;
  Eigen::FFT<double>().fwd(transformed, padded);
  Vector c(3 * n + 1);  // from -n to 2n
  for (Index d = -n; d <= 2 * n; ++d) c[n + d] = transformed[std::abs(d)].real();
  Vector sums(n);
  for (Index i = 1; i <= n; ++i)
    sums[i - 1] = (c.segment(n + 1 - i, n) - c.segment(n + 1 + i, n)).cwiseAbs().sum();  // c(j-i) - c(j+i), j = 1..n
  return sums;
}

}  // namespace

const LagTable* lag_table_of(const Weights& weights) { return std::get_if<LagTable>(&weights); }

const Recurrence* recurrence_of(const Weights& weights) { return std::get_if<Recurrence>(&weights); }

const ModalRecurrence* modal_recurrence_of(const Weights& weights) {
  const Recurrence* recurrence = recurrence_of(weights);
  return recurrence ? std::get_if<ModalRecurrence>(recurrence) : nullptr;
}

const PoleRecurrence* pole_recurrence_of(const Weights& weights) { return std::get_if<PoleRecurrence>(&weights); }

Matrix first_weight(const Weights& weights) {
  if (const PoleRecurrence* poles = pole_recurrence_of(weights)) return implicit_part(*poles);
  if (const LagTable* table = lag_table_of(weights))
    return Eigen::Map<const RowMatrix>(table->W.row(0).data(), table->outputs, table->inputs);
  if (const ModalRecurrence* modal = modal_recurrence_of(weights)) return implicit_part(*modal);
  return std::get<DenseRecurrence>(std::get<Recurrence>(weights)).w0;
}

Vector first_row_sums(const Weights& weights) {
  if (const ModalRecurrence* modal = modal_recurrence_of(weights);
      modal && modal->face.size() <= 1 && modal->face.is_sine())
    return row_sums_in_modes(modal->w0);
  return first_weight(weights).cwiseAbs().rowwise().sum();
}

LagTable coarsen(const LagTable& fine) {
  const Index last = (fine.W.rows() - 1) / 2, end = fine.W.rows() - 1;
  LagTable coarse{fine.outputs,
                  fine.inputs,
                  fine.modal,
                  RowMatrix(last + 1, fine.W.cols()),
                  RowMatrix::Zero(last + 1, fine.W.cols()),
                  fine.face};
  coarse.W.row(0) = fine.W.row(0) + 0.5 * fine.W.row(1);
  for (Index d = 1; d <= last; ++d) {
    coarse.W.row(d) = 0.5 * fine.W.row(2 * d - 1) + fine.W.row(2 * d);
    if (2 * d < end) coarse.W.row(d) += 0.5 * fine.W.row(2 * d + 1);  // the last lag acts only on y_0, through S
    coarse.S.row(d) = fine.S.row(2 * d) + 0.5 * fine.W.row(2 * d - 1);
  }
  return coarse;
}

ModalRecurrence coarsen(const ModalRecurrence& fine) {
  ModalRecurrence coarse;
  coarse.face = fine.face;
  const auto E = fine.decay.array(), C = fine.output.array();
  coarse.decay = E.square();
  coarse.output = 0.5 * C * (1 + E).square();
  coarse.start = (2 * E * fine.start.array() + 1) / (1 + E).square();
  coarse.w0 = fine.w0 + 0.5 * (fine.w1 + fine.output.colwise().sum().transpose());
  coarse.w1 = coarse.s1 = 0.5 * fine.w1;
  return coarse;
}

Weights coarsened(const Weights& fine, Index fine_steps, Index steps) {
  if (const PoleRecurrence* poles = pole_recurrence_of(fine))
    return PoleRecurrence{poles->model, poles->h * double(fine_steps / steps)};
  Weights weights = fine;
  for (Index at = fine_steps; at > steps; at /= 2) {
    if (const LagTable* table = lag_table_of(weights))
      weights = coarsen(*table);
    else
      weights = Recurrence(coarsen(*modal_recurrence_of(weights)));
  }
  return weights;
}

}  // namespace bromwich
