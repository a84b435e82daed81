#include "core/certificate/part_weights.hpp"

#include <utility>

namespace bromwich {

PartWeightsFamily::PartWeightsFamily(Matrix A, Matrix B, Matrix N, Matrix M, bool has_f)
    : phis_(std::move(A)), B_(std::move(B)), N_(std::move(N)), M_(std::move(M)), has_f_(has_f) {}

PartInputs part_inputs(PhiFamily& phis, double length) {
  PartInputs of;
  for (std::size_t i = 0; i < 2; ++i) {
    const double c = part_nodes[i], d = c * length;
    const auto phi = phis.phis(d);
    of[i] = {d * (*phi)[1], d * c * (*phi)[2], 2 * d * c * c * (*phi)[3]};
  }
  return of;
}

const PartWeights& PartWeightsFamily::of(double length) {
  const auto [found, added] = kept_.try_emplace(length);
  PartWeights& w = found->second;
  if (!added) return w;
  const Index n = M_.rows();
  const PartInputs input = part_inputs(phis_, length);
  for (std::size_t i = 0; i < 2; ++i) {
    w.decay[i] = (*phis_.phis(part_nodes[i] * length))[0];
    const Matrix constant = input[i][0] * B_, linear = input[i][1] * B_;  // of 1 and of σ
    w.drive[i].resize(B_.rows(), 2 * n);
    w.drive[i] << 1.5 * (constant - linear), 1.5 * linear - 0.5 * constant;
    w.answer[i] = M_.diagonal() + (N_ * w.drive[i].middleCols(Index(i) * n, n)).diagonal();
  }
  if (has_f_) w.input = input;
  return w;
}

}  // namespace bromwich
