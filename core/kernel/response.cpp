#include "core/kernel/response.hpp"

namespace bromwich {

RowMatrix row_modes(Backend& backend, const RowMatrix& rows) { return face_modes(backend, {rows.cols()}, rows); }

RowMatrix face_modes(Backend& backend, const std::vector<Index>& extents, const RowMatrix& rows) {
  const auto in = backend.array(rows.rows(), rows.cols()), out = backend.array(rows.rows(), rows.cols());
  backend.upload(rows, *in);
  backend.face_transform(extents, rows.rows())->apply(*in, nullptr, *out, 0);
  RowMatrix modes;
  backend.download(*out, modes);
  return modes;
}

RowMatrix x0_in_modes(Backend& backend, const KroneckerDynamics& d, const Vector& x0, bool both) {
  // S acts on rows, so transpose for the directions of the face.
  const Eigen::Map<const RowMatrix> lines(x0.data(), d.face_points(), d.across.points);
  const RowMatrix modes = face_modes(backend, d.face_extents(), lines.transpose()).transpose();
  return both ? in_line_modes(backend, d.across, modes) : modes;
}

RowMatrix in_line_modes(Backend& backend, const SecondDifference& across, const RowMatrix& lines) {
  return across.has_sine_modes() ? row_modes(backend, lines) : RowMatrix(lines * across.modes());
}

RowMatrix from_line_modes(Backend& backend, const SecondDifference& across, const RowMatrix& modes) {
  return across.has_sine_modes() ? row_modes(backend, modes) : RowMatrix(modes * across.modes().transpose());
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
