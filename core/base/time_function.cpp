#include "core/base/time_function.hpp"

#include <algorithm>
#include <array>

namespace bromwich {

TimeFunction::TimeFunction(SeparableSource source)
    : separable_(std::make_shared<const SeparableSource>(std::move(source))) {
  function_ = [kept = separable_](double t, Eigen::Ref<Vector> value) { (*kept)(t, value); };
}

bool TimeFunction::linear() const {
  return separable_ ? separable_->time.linear() : function_.target<LinearSource>() != nullptr;
}

void SeparableSource::operator()(double t, Eigen::Ref<Vector> value) const {
  std::array<double, 32> few;
  Vector many;
  if (shapes.cols() > Index(few.size())) many.resize(shapes.cols());
  Eigen::Map<Vector> a(many.size() > 0 ? many.data() : few.data(), shapes.cols());
  a.setZero();
  time(t, a);
  value.noalias() = shapes * a;
  if (a.allFinite()) return;
  // A function that is not finite at t is no part of entries where its shape is zero.
  value.setZero();
  for (Index c = 0; c < shapes.cols(); ++c) value += (shapes.col(c).array() == 0).select(0, shapes.col(c) * a[c]);
}

namespace {

// Values of functions behind each other.
struct Stack {
  struct Part {
    TimeFunction function;
    Index at, width;
  };
  std::vector<Part> parts;

  void operator()(double t, Eigen::Ref<Vector> value) const {
    for (const Part& p : parts) p.function(t, value.segment(p.at, p.width));
  }
  bool linear() const {
    return std::all_of(parts.begin(), parts.end(), [](const Part& p) { return p.function.linear(); });
  }
};

}  // namespace

TimeFunction sum_of(const std::vector<SourceTerm>& terms) {
  Matrix shapes;
  Stack stack;
  for (const auto& [by, function] : terms) {
    if (!function) continue;
    const SeparableSource* separable = function.separable();
    const Matrix columns = separable ? Matrix(by * separable->shapes) : by;
    const Index at = shapes.cols();
    shapes.conservativeResize(by.rows(), at + columns.cols());
    shapes.rightCols(columns.cols()) = columns;
    stack.parts.push_back({separable ? separable->time : function, at, columns.cols()});
  }
  if (stack.parts.empty()) return {};
  if (stack.parts.size() == 1) return SeparableSource{std::move(shapes), std::move(stack.parts.front().function)};
  const bool linear = stack.linear();
  TimeFunction time = std::move(stack);
  return SeparableSource{std::move(shapes), linear ? TimeFunction(LinearSource{std::move(time)}) : std::move(time)};
}

TimeFunction one_at_all_times() {
  return LinearSource{[](double, Eigen::Ref<Vector> value) { value.setOnes(); }};
}

}  // namespace bromwich
