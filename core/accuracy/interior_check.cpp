#include "core/accuracy/interior_check.hpp"

#include "core/base/interruption.hpp"
#include "core/kernel/discrete_problem.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace bromwich {

namespace {

// Irrational, and no multiples of each other.
constexpr std::array<double, 3> places{0.2360679774997897, 0.5857864376269049, 0.8284271247461901};

// Which of the places a step is looked at: no period that a solution could share.
std::size_t place_of(Index j) { return std::size_t((std::uint64_t(j) * 0x9E3779B97F4A7C15u) >> 40) % places.size(); }

class Inputs {
 public:
  explicit Inputs(const Scene& scene) : scene_(scene), d_(*scene.dynamics->small_state()) {
    if (scene.f_entry == SourceEntry::through_B) F_ = d_.B;
    if (scene.f_entry == SourceEntry::through_F) F_ = scene.F;
  }

  // B y + f(t).
  Vector operator()(const Vector& y, double t) const {
    Vector u = d_.B * y;
    if (!scene_.f) return u;
    Vector f = Vector::Zero(scene_.sources());
    scene_.f(t, f);
    if (F_.size() > 0)
      u.noalias() += F_ * f;
    else
      u += f;
    return u;
  }

 private:
  const Scene& scene_;
  const DenseDynamics& d_;
  Matrix F_;
};

// A dip of w_i below 0 between points at which it is positive: where the slopes on both sides, carried on, meet below
// 0, g is searched for the lowest value of g + (N x + M y, linear). Returns how far below 0.
double dip(const Scene& scene, const Matrix& w, const Matrix& g, Index j, Index i, double h) {
  if (j < 1 || j + 2 >= w.rows() || !(w(j, i) > 0) || !(w(j + 1, i) > 0)) return 0;
  const double left = w(j, i) - w(j - 1, i), right = w(j + 2, i) - w(j + 1, i);  // a step each
  if (!(left < 0) || !(right > 0)) return 0;
  const double place = (w(j + 1, i) - right - w(j, i)) / (left - right);
  if (!(place > 0) || !(place < 1) || w(j, i) + place * left >= 0) return 0;
  Vector value(w.cols());
  const auto at = [&](double part) {
    scene.g((double(j) + part) * h, value);
    return value[i] + (1 - part) * (w(j, i) - g(j, i)) + part * (w(j + 1, i) - g(j + 1, i));
  };
  double a = 0, b = 1;
  for (int k = 0; k < 40; ++k) {  // (2/3)^40 = 1e-7 of the step
    const double third = (b - a) / 3;
    (at(a + third) < at(b - third) ? b = b - third : a = a + third);
  }
  return std::max(0.0, -at((a + b) / 2));
}

}  // namespace

double interior_defect(const Scene& scene, const Result& r, const RowMatrix& x, const ComponentSizes& sizes) {
  const DenseDynamics& d = *scene.dynamics->small_state();
  const Matrix M = to_dense(scene.M);
  const Index J = r.steps, n = M.rows();
  const double h = scene.T / double(J);
  std::array<StepOperators, places.size()> steps;
  for (std::size_t k = 0; k < places.size(); ++k) steps[k] = step_operators(d.A, Rule::exponential, places[k] * h);
  const Inputs input(scene);
  Vector sum = Vector::Zero(n), g = Vector::Zero(n);
  Matrix known = Matrix::Zero(J + 1, n);
  for (Index j = 0; j <= J && scene.g; ++j) {
    scene.g(double(j) * h, g);
    known.row(j) = g.transpose();
  }
  const Matrix slack = x * d.N.transpose() + r.y * M.transpose() + known;
  for (Index j = 0; j < J; ++j) {
    if (j % 64 == 0) check_interruption();
    for (Index i = 0; i < n && scene.g; ++i)
      if (M(i, i) > 0) sum[i] += dip(scene, slack, known, j, i, h) / M(i, i);
    const std::size_t k = place_of(j);
    const double from = double(j) * h, t = from + places[k] * h;
    if (r.defects && std::binary_search(r.defects->steps.begin(), r.defects->steps.end(), j + 1)) continue;
    const auto next = std::lower_bound(scene.breakpoints.begin(), scene.breakpoints.end(), from * (1 - 1e-12));
    if (next != scene.breakpoints.end() && *next <= from + h * (1 + 1e-12)) continue;
    const Vector y = ((1 - places[k]) * r.y.row(j) + places[k] * r.y.row(j + 1)).transpose();
    const Vector at = steps[k].decay * x.row(j).transpose() + steps[k].left * input(r.y.row(j).transpose(), from) +
                      steps[k].right * input(y, t);
    g.setZero();
    if (scene.g) scene.g(t, g);
    const Vector w = d.N * at + M * y + g;
    for (Index i = 0; i < n; ++i)
      if (M(i, i) > 0) sum[i] += std::abs(std::min(y[i], w[i] / M(i, i)));
  }
  const Vector size = sizes.of_mean(r);
  return (sum.array() > 0).select(sum.cwiseQuotient(size), 0).maxCoeff() / double(J);
}

Vector hidden_error(const Vector& diagonal, const Vector& y_coarse, const Vector& y_fine, const Vector& e,
                    const Vector& w) {
  Vector hidden = Vector::Zero(e.size());
  for (Index i = 0; i < e.size(); ++i)
    if (diagonal[i] > 0 && !(y_fine[i] > 0) && !(y_coarse[i] > 0))
      hidden[i] = std::clamp(e[i] - w[i], 0.0, e[i]) / diagonal[i];
  return hidden;
}

HiddenError hidden_error(const Scene& scene, const Result& coarse, const Result& fine, double share,
                         const ComponentSizes& sizes) {
  const Index n = fine.y.cols();
  const auto known = [n](const Result& r) {
    return r.trace.rows() == r.steps + 1 && r.trace.cols() == n && r.trace.allFinite();
  };
  if (n != size(scene.M) || !known(coarse) || !known(fine)) return {};
  Vector of_M = diagonal(scene.M);
  of_M(scene.free_rows).setZero();
  Vector largest = Vector::Zero(n), sum = largest, g = largest;
  for (Index j = 1; j <= coarse.steps; ++j) {
    if (j % 64 == 0) check_interruption();
    const Vector v = fine.trace.row(2 * j).transpose(), y = fine.y.row(2 * j).transpose();
    const Vector e = share * (v - coarse.trace.row(j).transpose()).cwiseAbs();
    if (scene.g) scene.g(fine.t[2 * j], g);
    const Vector hidden = hidden_error(of_M, coarse.y.row(j).transpose(), y, e, v + multiply(scene.M, y) + g);
    largest = largest.cwiseMax(hidden);
    sum += hidden;
  }
  return {largest_share(largest, sizes.of_y(fine)),
          largest_share(Vector(sum / double(coarse.steps)), sizes.of_mean(fine))};
}

double missed_between_points(const TimeFunction& function, Index width, const std::vector<double>& breakpoints,
                             const Vector& t) {
  constexpr int looks = 8;  // into a part between breakpoints
  const Index J = t.size() - 1;
  if (!function || width == 0) return 0;
  const OneSided source(function, width, 256 * epsilon * t[J]);
  Vector missed = Vector::Zero(source.width()), whole = missed, left, right, value;
  source.value(t[0], right);
  auto next = breakpoints.begin();
  for (Index j = 1; j <= J; ++j) {
    left = right;
    source.value(t[j], right);
    const double h = t[j] - t[j - 1];
    whole += h / 2 * (left.cwiseAbs() + right.cwiseAbs());
    while (next != breakpoints.end() && *next <= t[j - 1]) ++next;
    for (double from = t[j - 1]; next != breakpoints.end() && from < t[j] && *next < t[j];) {
      const auto behind = next + 1;
      const bool last = behind == breakpoints.end() || *behind >= t[j];
      for (const auto& [a, b] : {std::pair(from, *next), std::pair(*next, last ? t[j] : *next)})
        for (int k = 0; k < looks && b > a; ++k) {
          const double at = a + (b - a) * (k + 0.5) / looks, part = (at - t[j - 1]) / h;
          source.value(at, value);
          missed += (b - a) / looks * (value - (1 - part) * left - part * right).cwiseAbs();
        }
      from = *next;
      next = behind;
    }
  }
  whole += missed;
  whole = whole.cwiseMax(1e-3 * whole.maxCoeff());
  return (missed.array() > 0).select(missed.cwiseQuotient(whole), 0).maxCoeff();
}

}  // namespace bromwich
