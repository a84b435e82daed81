#include "tests/support/stepped_flow.hpp"

#include "tests/support/flow_base.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich::oracle {
namespace {

const double gamma = 1 - std::sqrt(0.5);  // SDIRK: stages at gamma h and h, both with the factor gamma

class StageMaker : public FlowBase {
 public:
  StageMaker(const EngineeringScene& s, const StageSteps& steps, const Vector& x0, double T)
      : FlowBase(s, x0, T, steps.resistance), steps_(steps), wide_(x0.cast<long double>()) {}

 private:
  void piece(double begin, double end) override {
    const double shortest = std::min(steps_.shortest * unit_, 1e-3 * (end - begin));
    double t = begin, h = shortest;
    bool jump = true;
    while (flow_.decided && t < end) {
      if (++flow_.steps > steps_.most) return undecided("too many steps", t);
      if (end - t < 2 * shortest) jump = true;
      if (jump) {
        h = end - t < 4 * shortest ? end - t : shortest;
        const auto half = stage(wide_, t + h / 2, h / 2);
        const auto whole = half ? stage(half->x, t + h, h / 2) : half;
        if (!whole || !whole->x.allFinite()) return undecided("the problem of a short step has no solution", t);
        ++flow_.events;
        keep(t, h, end, half->x, whole->x);
        h = 4 * shortest, jump = false;
        continue;
      }
      h = std::min({h, end - t, unit_ / 64});
      const auto first = step(wide_, t, h / 2), second = first ? step(*first, t + h / 2, h / 2) : first,
                 whole = second ? step(wide_, t, h) : second;
      const double error = whole ? size_of((*whole - *second).cast<double>()) / 3 : INFINITY;
      if (!(error <= steps_.error)) {
        h /= 2, jump = h < 2 * shortest;
        continue;
      }
      keep(t, h, end, *first, *second);
      if (error < steps_.error / 10) h *= 2;
    }
  }

  std::optional<Wide> step(const Wide& x, double t, double h) {
    const auto inner = stage(x, t + gamma * h, gamma * h);
    if (!inner) return std::nullopt;
    const auto outer = stage(x + static_cast<long double>((1 - gamma) / gamma) * (inner->x - x), t + h, gamma * h);
    if (!outer || !outer->x.allFinite()) return std::nullopt;
    return outer->x;
  }

  /// A parabola through both halves of a step.
  void keep(double& t, double h, double end, const Wide& half, const Wide& whole) {
    const Vector middle = half.cast<double>(), last = whole.cast<double>();
    Matrix nodes(m_, 4);
    nodes.col(0) = x_, nodes.col(3) = last;
    for (Index k = 0; k < 2; ++k) {
      const double a = radau_nodes[k];
      nodes.col(k + 1) = (1 - a) * (1 - 2 * a) * x_ + 4 * a * (1 - a) * middle + a * (2 * a - 1) * last;
    }
    flow_.pieces.push_back({t, h, std::move(nodes)});
    x_ = last, wide_ = whole;
    flow_.largest = flow_.largest.cwiseMax(x_.cwiseAbs());
    t = end - t - h < 1e-9 * h ? end : t + h;
  }

  StageSteps steps_;
  Wide wide_;  ///< x
};

}  // namespace

Flow stepped_flow(const EngineeringScene& s, const Vector& x0, double T, const StageSteps& steps) {
  return StageMaker(s, steps, x0, T).run();
}

}  // namespace bromwich::oracle
