#include "core/base/time_function.hpp"

namespace bromwich {

TimeFunction::TimeFunction(SeparableSource source)
    : separable_(std::make_shared<const SeparableSource>(std::move(source))) {
  function_ = [kept = separable_](double t, Eigen::Ref<Vector> value) { (*kept)(t, value); };
}

void SeparableSource::operator()(double t, Eigen::Ref<Vector> value) const {
  Vector a = Vector::Zero(shapes.cols());
  time(t, a);
  value.noalias() = shapes * a;
}

}  // namespace bromwich
