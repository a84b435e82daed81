// Limits of a source from both sides: OneSided of source_steps.hpp.

#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double jump_beside = 1e-3;  ///< of a value: change within places that are not told apart

}  // namespace

OneSided::OneSided(const TimeFunction& function, Index width, double resolution)
    : function_(&function), shapes_(nullptr), width_(width), resolution_(resolution) {
  const auto* separable = function.separable();
  if (!separable) return;
  function_ = &separable->time;
  shapes_ = &separable->shapes;
  width_ = shapes_->cols();
}

void OneSided::value(double t, Vector& v) const {
  v.setZero(width_);
  if (width_ > 0 && *function_) (*function_)(t, v);
}

// Continued from two values beside t. A jump between the two is not continued.
Vector OneSided::limit(double t, double distance) const {
  Vector near, far;
  value(t + distance, near);
  value(t + 2 * distance, far);
  for (Index i = 0; i < near.size(); ++i)
    if (!(std::abs(near[i] - far[i]) > jump_beside * std::abs(near[i]))) near[i] = 2 * near[i] - far[i];
  return near;
}

Vector OneSided::after(double t, double length) const { return limit(t, std::min(4 * resolution_, length / 8)); }
Vector OneSided::before(double t, double length) const { return limit(t, -std::min(4 * resolution_, length / 8)); }
Vector OneSided::whole(const Vector& v) const { return shapes_ ? Vector(*shapes_ * v) : v; }

}  // namespace bromwich
