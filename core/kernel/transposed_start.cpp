#include "core/kernel/transposed_start.hpp"

#include "core/kernel/response.hpp"
#include "core/kernel/weights.hpp"

#include <algorithm>

namespace bromwich {

namespace {

// From the adjoint state Σ_j (E^T)^{j-1} C^T u_j.
Vector sum_over_start(const DenseRecurrence& r, const RowMatrix& u) {
  const Matrix decay = r.decay.transpose(), output = r.output.transpose();
  Vector z = Vector::Zero(decay.rows());
  for (Index j = u.rows() - 1; j >= 1; --j) z = (decay * z + output * u.row(j).transpose()).eval();
  return r.start.transpose() * z;
}

constexpr Index modes_together = 8, chains = 4;  ///< modes and exponentials that go through time together

// Σ_j E_k^{j-1} u_j of some modes and the exponentials k to k + chains, by Horner's rule. `rows`: u_1, u_2, ...
using ModeLanes = Eigen::Array<double, modes_together, 1>;
void add_chains(const ModalRecurrence& r, const std::vector<ModeLanes>& rows, Index first, Index count, Index k,
                ModeLanes& sum) {
  ModeLanes z[chains], decay[chains];
  const Index used = std::min(chains, r.exponentials() - k);
  for (Index c = 0; c < chains; ++c) {
    z[c].setZero();
    decay[c].setZero();
    if (c < used) decay[c].head(count) = r.decay.row(k + c).segment(first, count).transpose();
  }
  for (std::size_t j = rows.size(); j-- > 0;)
    for (Index c = 0; c < chains; ++c) z[c] = z[c] * decay[c] + rows[j];
  for (Index c = 0; c < used; ++c)
    sum.head(count) += r.output.row(k + c).segment(first, count).transpose().array() *
                       r.start.row(k + c).segment(first, count).transpose().array() * z[c].head(count);
}

// The same in modes.
Vector sum_over_start(const ModalRecurrence& r, const RowMatrix& u) {
  const Index n = r.modes(), J = u.rows() - 1;
  Vector sum = J > 0 ? Vector(r.s1.cwiseProduct(u.row(1).transpose())) : Vector(Vector::Zero(n));
  std::vector<ModeLanes> rows(std::size_t(J), ModeLanes::Zero());
  for (Index first = 0; first < n; first += modes_together) {
    const Index count = std::min(modes_together, n - first);
    for (Index j = 0; j < J; ++j)
      rows[std::size_t(j)].head(count) = u.row(j + 1).segment(first, count).transpose().array();
    ModeLanes added = ModeLanes::Zero();
    for (Index k = 0; k < r.exponentials(); k += chains) add_chains(r, rows, first, count, k, added);
    sum.segment(first, count) += added.head(count).matrix();
  }
  return sum;
}

Vector sum_over_start(const LagTable& table, const RowMatrix& u) {
  if (table.modal) return table.S.middleRows(1, u.rows() - 1).cwiseProduct(u.bottomRows(u.rows() - 1)).colwise().sum();
  Vector sum = Vector::Zero(table.inputs);
  for (Index j = 1; j < u.rows(); ++j)
    sum += Eigen::Map<const RowMatrix>(table.S.row(j).data(), table.outputs, table.inputs).transpose() *
           u.row(j).transpose();
  return sum;
}

}  // namespace

FaceBasis modal_face(const Weights& weights) {
  if (const LagTable* table = lag_table_of(weights)) return table->modal ? table->basis() : FaceBasis{};
  const ModalRecurrence* modal = modal_recurrence_of(weights);
  return modal ? modal->basis() : FaceBasis{};
}

Vector transposed_start(Backend& backend, const Weights& weights, const RowMatrix& u) {
  const FaceBasis face = modal_face(weights);
  const RowMatrix seen = face.empty() ? u : transformed(backend, face, u, Way::to_modes);
  const LagTable* table = lag_table_of(weights);
  const Vector sum = table
                         ? sum_over_start(*table, seen)
                         : std::visit([&](const auto& r) { return sum_over_start(r, seen); }, *recurrence_of(weights));
  if (face.empty()) return sum;
  return transformed(backend, face, sum.transpose(), Way::to_points).transpose();
}

}  // namespace bromwich
