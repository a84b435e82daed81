#include "core/kernel/discrete_problem.hpp"

#include "core/kernel/kernel.hpp"

namespace bromwich {

void add_rough_response(const DiscreteProblem& p, Array& r) {
  if (!p.rough_response) return;
  const auto more = p.backend.array(p.rough_response->rows(), p.rough_response->cols());
  p.backend.upload(*p.rough_response, *more);
  p.backend.add(r, 1, *more, r);
}

std::size_t host_bytes(const DiscreteProblem& p) {
  return sizeof(double) * std::size_t(p.g.size()) + p.g.bytes() + p.f.bytes();
}

std::shared_ptr<const StepOperators> state_step(const DiscreteProblem& p, Rule rule) {
  if (rule != Rule::exponential) return p.shared->step(rule, p.h, p.J);
  return p.exponential_step->get([&] { return p.shared->step(rule, p.h, p.J); });
}

RowMatrix state_input(const DiscreteProblem& p, const RowMatrix& y) { return state_input(p, y, 0, y.rows()); }

RowMatrix state_input(const DiscreteProblem& p, const RowMatrix& y, Index first, Index rows) {
  const Matrix& B = p.small_state()->B;
  const auto part = y.middleRows(first, rows);
  if (const SampledSource* phi = p.drive()) return (part + phi->rows(first, rows).table()) * B.transpose();
  RowMatrix input = part * B.transpose();
  if (p.f.size() > 0 && p.scene.f_entry == SourceEntry::through_F)
    input += p.f.rows(first, rows).table() * p.scene.F.transpose();
  else if (p.f.size() > 0)
    input += p.f.rows(first, rows).table();
  return input;
}

RowMatrix states_from(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const StepDefects* defects) {
  if (!defects && rule == Rule::exponential) defects = p.defects.get();
  return dense_states(*state_step(p, rule), p.scene.x0, state_input(p, y), defects);
}

RowMatrix dense_response(const DiscreteProblem& p, Rule rule) {
  const RowMatrix none = RowMatrix::Zero(p.J + 1, p.scene.constraints());
  return p.g.table() + states_from(p, rule, none) * p.small_state()->N.transpose();
}

RowMatrix trace(const DiscreteProblem& p, const Array& r, const Array& v) {
  RowMatrix known, response;
  p.backend.download(r, known);
  p.backend.download(v, response);
  return known + response - p.g.table();
}

RowMatrix kronecker_initial_response(const DiscreteProblem& p) {
  const KroneckerDynamics& d = *p.modes();
  return contour_initial_response(d, *contour_parameters(0), x0_in_modes(p.backend, d, p.scene.x0, false), p.h, p.J);
}

}  // namespace bromwich
