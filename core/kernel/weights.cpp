#include "core/kernel/weights.hpp"

#include "core/kernel/pole_plans.hpp"

#include <unsupported/Eigen/FFT>

#include <cmath>

namespace bromwich {

namespace {

constexpr Index modes_together = 2048;  ///< of a thread

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

ModalRecurrence coarsen(const ModalRecurrence& fine, const HostThreads& threads) {
  const Index K = fine.exponentials(), n = fine.modes();
  ModalRecurrence coarse;
  coarse.face = fine.face;
  coarse.families = fine.families;
  for (RowMatrix* table : {&coarse.decay, &coarse.output, &coarse.start}) table->resize(K, n);
  coarse.w0 = fine.w0 + 0.5 * fine.w1;
  coarse.w1 = coarse.s1 = 0.5 * fine.w1;
  threads.each_range(n, modes_together, [&](Index first, Index last) {
    const auto part = [first, count = last - first](auto& table, Index k) {
      return table.row(k).segment(first, count).array();
    };
    for (Index k = 0; k < K; ++k) {
      const auto E = part(fine.decay, k), C = part(fine.output, k);
      part(coarse.decay, k) = E.square();
      part(coarse.output, k) = 0.5 * C * (1 + E).square();
      part(coarse.start, k) = (2 * E * part(fine.start, k) + 1) / (1 + E).square();
      coarse.w0.segment(first, last - first).array() += 0.5 * C.transpose();
    }
  });
  return coarse;
}

Weights coarsened(const Weights& fine, Index fine_steps, Index steps, const HostThreads& threads) {
  if (const PoleRecurrence* poles = pole_recurrence_of(fine))
    return PoleRecurrence{poles->model, poles->h * double(fine_steps / steps)};
  if (fine_steps == steps) return fine;
  const LagTable* table = lag_table_of(fine);
  Weights half = table ? Weights(coarsen(*table)) : Weights(Recurrence(coarsen(*modal_recurrence_of(fine), threads)));
  if (fine_steps / 2 > steps) half = coarsened(half, fine_steps / 2, steps, threads);
  return half;
}

}  // namespace bromwich
