#include "core/certificate/part_weights.hpp"

#include <utility>

namespace bromwich {

PartWeightsFamily::PartWeightsFamily(Matrix A, Matrix B, Matrix N, Matrix M, bool has_f)
    : phis_(std::move(A)), B_(std::move(B)), N_(std::move(N)), M_(std::move(M)), has_f_(has_f) {}

const PartWeights& PartWeightsFamily::of(double length) {
  if (const auto found = kept_.find(length); found != kept_.end()) return found->second;
  const Index n = M_.rows();
  PartWeights w;
  for (std::size_t i = 0; i < 2; ++i) {
    const double c = part_nodes[i], d = c * length;
    const auto phi = phis_.phis(d);
    w.decay[i] = (*phi)[0];
    const Matrix constant = d * (*phi)[1] * B_, linear = d * c * (*phi)[2] * B_;  // of 1 and of σ
    w.drive[i].resize(B_.rows(), 2 * n);
    w.drive[i] << 1.5 * (constant - linear), 1.5 * linear - 0.5 * constant;
    if (has_f_) w.input[i] = {d * (*phi)[1], d * c * (*phi)[2], 2 * d * c * c * (*phi)[3]};
    w.slack[i].noalias() = N_ * w.drive[i];
    w.slack[i].middleCols(Index(i) * n, n) += M_;
  }
  return kept_.emplace(length, std::move(w)).first->second;
}

}  // namespace bromwich
