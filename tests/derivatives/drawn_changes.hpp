#pragma once
// Scenes, changes of their data, and scenes with changed data, for tests of derivatives.

#include "catalogue/catalogue.hpp"
#include "derivatives/solution_derivative.hpp"
#include "tests/support/reference.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::derivative_test {

using reference::Random;

// Smooth sources and no y_i = w_i = 0: heat with a unilateral condition on one face.
inline Scene warmed(const char* name, double Q, double T = 1) {
  Scene s = make_scene(name, {{"Q", Q}});
  const Index n = s.constraints();
  s.f = [](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = 0.3 * std::sin(3 * t + double(i));
  };
  s.f_entry = SourceEntry::through_B;
  s.g = [](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = std::sin(5 * t + 0.7 + 0.4 * double(i));
  };
  s.x0 = 0.1 * Random(std::uint32_t(n)).vector(s.states());
  s.T = T;
  return s;
}

inline DataChange drawn(const Scene& s, Index J, unsigned seed) {
  Random random(seed);
  const Index n = s.constraints();
  DataChange c;
  c.x0 = random.vector(s.states());
  c.f = random.matrix(J + 1, n), c.g = random.matrix(J + 1, n), c.M = random.matrix(n, n);
  return c;
}

inline TimeFunction with_rows(const TimeFunction& given, const RowMatrix& rows, double T, double by) {
  return [=](double t, Eigen::Ref<Vector> v) {
    given(t, v);
    const Index J = rows.rows() - 1;
    const double at = std::clamp(t / T, 0.0, 1.0) * double(J), below = std::min(std::floor(at), double(J - 1));
    v += by * ((1 - at + below) * rows.row(Index(below)) + (at - below) * rows.row(Index(below) + 1)).transpose();
  };
}

inline Scene changed(const Scene& s, const DataChange& c, double by) {
  Scene other = s;
  if (c.x0.size() > 0) other.x0 += by * c.x0;
  if (c.f.size() > 0) other.f = with_rows(s.f, c.f, s.T, by);
  if (c.g.size() > 0) other.g = with_rows(s.g, c.g, s.T, by);
  if (c.M.size() > 0) other.M = Matrix(to_dense(s.M) + by * c.M);
  return other;
}

inline double dot(const RowMatrix& a, const RowMatrix& b) { return a.cwiseProduct(b).sum(); }

}  // namespace bromwich::derivative_test
