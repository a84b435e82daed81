#include "core/kernel/response.hpp"

namespace bromwich {

RowMatrix transformed(Backend& backend, const FaceBasis& basis, const RowMatrix& rows, Way way) {
  const auto in = backend.array(rows.rows(), rows.cols()), out = backend.array(rows.rows(), rows.cols());
  backend.upload(rows, *in);
  backend.face_transform(basis, rows.rows(), way)->apply(*in, nullptr, *out, 0);
  RowMatrix found;
  backend.download(*out, found);
  return found;
}

RowMatrix x0_in_modes(Backend& backend, const KroneckerDynamics& d, const Vector& x0, bool both) {
  // Transforms act on rows, so transpose for the directions of the face.
  const Vector views = d.views(x0);
  const Eigen::Map<const RowMatrix> lines(views.data(), d.face_points(), d.across.points);
  const RowMatrix modes = transformed(backend, d.face_basis(), lines.transpose(), Way::to_modes).transpose();
  return both ? in_line_modes(backend, d.across, modes) : modes;
}

RowMatrix in_line_modes(Backend& backend, const SecondDifference& across, const RowMatrix& lines) {
  return transformed(backend, across.basis(), lines, Way::to_modes);
}

RowMatrix from_line_modes(Backend& backend, const SecondDifference& across, const RowMatrix& modes) {
  return transformed(backend, across.basis(), modes, Way::to_points);
}

RowMatrix dense_states(const StepOperators& step, const Vector& x0, const RowMatrix& u, const StepDefects* defects) {
  // Products over all time points first; the sequential part is then one small matrix-vector product per step.
  RowMatrix x = u * step.right.transpose();
  x.bottomRows(x.rows() - 1) += u.topRows(u.rows() - 1) * step.left.transpose();
  if (defects) defects->add_to(x);
  x.row(0) = x0.transpose();
  for (Index j = 1; j < x.rows(); ++j) x.row(j).transpose().noalias() += step.decay * x.row(j - 1).transpose();
  return x;
}

}  // namespace bromwich
