// Modes of a second difference with reflecting ends, u_0 = p u_1 and u_{n+1} = q u_n. With
//
//     u_i = sin(i theta + alpha_p(theta)),   alpha_p(theta) = arg(1 - p e^{-i theta}),
//
// the condition at the first end holds for every theta, and that at the last one if
//
//     (n + 1) theta + alpha_p(theta) + alpha_q(theta) = k pi,   k = 1..n.
//
// The left side grows, by at least n, so each k has one theta in [0, pi]: k pi/(n+1) with two Dirichlet ends,
// (k-1) pi/n with two Neumann ends, (k-1/2) pi/(n+1/2) with one of each.

#include "core/dynamics/second_difference.hpp"

#include "core/numerics/sine_basis.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <numbers>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

double phase(double reflection, double theta) {
  if (reflection == 1) return (std::numbers::pi - theta) / 2;
  // 1 - p cos(theta) without cancellation for p near 1.
  const double half = std::sin(theta / 2);
  return std::atan2(reflection * std::sin(theta), 1 - reflection + 2 * reflection * half * half);
}

// theta_k. Newton's steps stay in a bracket, which halves where they leave it.
double angle(const SecondDifference& d, Index k) {
  const double n = double(d.points), pi = std::numbers::pi;
  if (d.has_sine_modes()) return double(k) * pi / (n + 1);
  if (d.first == 1 && d.last == 1) return double(k - 1) * pi / n;
  const auto left = [&](double theta) { return (n + 1) * theta + phase(d.first, theta) + phase(d.last, theta); };
  double low = 0, high = pi, theta = (double(k) - 0.5) * pi / (n + 0.5);
  for (int i = 0; i < 200; ++i) {
    const double over = left(theta) - double(k) * pi;
    (over > 0 ? high : low) = theta;
    double next = theta - over / (n + 1);
    if (!(next > low && next < high)) next = (low + high) / 2;
    if (std::abs(next - theta) <= epsilon * theta) break;
    theta = next;
  }
  return theta;
}

// u_i of norm 1: sum_i sin^2(i theta + alpha) = (n - sin(n theta) cos((n+1) theta + 2 alpha) / sin(theta)) / 2.
class LineMode {
 public:
  LineMode(const SecondDifference& d, Index k) : theta_(angle(d, k)), alpha_(phase(d.first, theta_)) {
    const double n = double(d.points), quotient = theta_ > 0 ? std::sin(n * theta_) / std::sin(theta_) : n;
    factor_ = std::sqrt(2 / (n - quotient * std::cos((n + 1) * theta_ + 2 * alpha_)));
  }
  double operator()(Index i) const { return factor_ * std::sin(double(i) * theta_ + alpha_); }

 private:
  double theta_, alpha_, factor_ = 0;
};

}  // namespace

Vector SecondDifference::eigenvalues() const {
  const double scale = -4 * diffusivity / (spacing * spacing);
  Vector lambda(points);
  for (Index k = 1; k <= points; ++k) {
    const double s = std::sin(angle(*this, k) / 2);
    lambda[k - 1] = scale * s * s - decay;
  }
  return lambda;
}

Matrix SecondDifference::modes() const {
  if (has_sine_modes()) return sine_matrix(points);
  Matrix Q(points, points);
  for (Index k = 0; k < points; ++k) {
    const LineMode mode(*this, k + 1);
    for (Index i = 0; i < points; ++i) Q(i, k) = mode(i + 1);
  }
  return Q;
}

FaceBasis SecondDifference::basis() const {
  if (has_sine_modes() || points == 1) return FaceBasis{points};
  struct Known {
    Index points;
    double first, last;
    std::weak_ptr<const Matrix> V;
  };
  static std::mutex mutex;
  static std::vector<Known> all;
  const std::lock_guard lock(mutex);
  std::erase_if(all, [](const Known& known) { return known.V.expired(); });
  for (const Known& known : all)
    if (known.points == points && known.first == first && known.last == last)
      if (auto V = known.V.lock()) return FaceBasis(std::vector<LineBasis>{{points, std::move(V)}});
  const auto V = std::make_shared<const Matrix>(modes());
  all.push_back({points, first, last, V});
  return FaceBasis(std::vector<LineBasis>{{points, V}});
}

Vector SecondDifference::in_modes(const Vector& v) const {
  if (has_sine_modes()) return in_sine_basis(v);
  Vector found = Vector::Zero(points);
  for (Index k = 0; k < points; ++k) {
    const LineMode mode(*this, k + 1);
    for (Index i = 0; i < points; ++i)
      if (v[i] != 0) found[k] += v[i] * mode(i + 1);
  }
  return found;
}

}  // namespace bromwich
