#include "core/separable.hpp"

namespace bromwich {

void SeparableSource::operator()(double t, Eigen::Ref<Vector> value) const {
  Vector a = Vector::Zero(shapes.cols());
  time(t, a);
  value.noalias() = shapes * a;
}

RowMatrix sample(const SeparableSource& source, const Vector& t) {
  Vector a(source.shapes.cols());
  RowMatrix values(t.size(), source.shapes.rows());
  for (Index j = 0; j < t.size(); ++j) {
    a.setZero();
    source.time(t[j], a);
    values.row(j).noalias() = (source.shapes * a).transpose();
  }
  return values;
}

}  // namespace bromwich
