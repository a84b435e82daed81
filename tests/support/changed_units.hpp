#pragma once
// A scene in other units: x_i = 10^{x_i} x'_i, the same for y and w, t = 10^{time} t'. Applied entry by entry, without
// the solver's own scaling.

#include "core/scene/scene.hpp"

#include <cmath>
#include <random>
#include <utility>
#include <vector>

namespace bromwich::oracle {

struct UnitChange {
  std::vector<int> x, y, w;
  int time = 0;
};

inline double power_of_ten(int k) { return k >= 0 ? std::pow(10.0, k) : 1 / std::pow(10.0, -k); }

/// Exponents in [-largest, largest]. In a Kronecker sum all rows of one kind share a unit.
inline UnitChange any_units(const Scene& scene, std::uint32_t seed, int largest, int largest_of_time) {
  std::mt19937 engine(seed);
  const auto draw = [&engine](int most) { return int(engine() % std::uint32_t(2 * most + 1)) - most; };
  const bool common = holds<KroneckerDynamics>(scene.dynamics);
  UnitChange u;
  for (const auto& [exponents, count] :
       {std::pair(&u.x, scene.states()), std::pair(&u.y, scene.constraints()), std::pair(&u.w, scene.constraints())}) {
    const int all = draw(largest);
    for (Index i = 0; i < count; ++i) exponents->push_back(common ? all : draw(largest));
  }
  u.time = draw(largest_of_time);
  return u;
}

inline Vector factors(const std::vector<int>& exponents) {
  Vector f(Index(exponents.size()));
  for (Index i = 0; i < f.size(); ++i) f[i] = power_of_ten(exponents[std::size_t(i)]);
  return f;
}

inline TimeFunction in_other_units(const TimeFunction& function, const Vector& units, double time) {
  if (!function) return {};
  return [=](double t, Eigen::Ref<Vector> value) {
    function(t * time, value);
    value.array() /= units.array();
  };
}

inline Scene in_other_units(Scene scene, const UnitChange& u) {
  const Vector X = factors(u.x), Y = factors(u.y), W = factors(u.w);
  const double time = power_of_ten(u.time);
  if (auto* dense = get_if<DenseDynamics>(&scene.dynamics)) {
    dense->A = X.cwiseInverse().asDiagonal() * (time * dense->A) * X.asDiagonal();
    dense->B = X.cwiseInverse().asDiagonal() * (time * dense->B) * Y.asDiagonal();
    dense->N = W.cwiseInverse().asDiagonal() * dense->N * X.asDiagonal();
  } else if (auto* sparse = get_if<SparseDynamics>(&scene.dynamics)) {
    sparse->A = SparseMatrix(X.cwiseInverse().asDiagonal() * SparseMatrix(time * sparse->A) * X.asDiagonal());
    sparse->B = SparseMatrix(X.cwiseInverse().asDiagonal() * SparseMatrix(time * sparse->B) * Y.asDiagonal());
    sparse->N = SparseMatrix(W.cwiseInverse().asDiagonal() * sparse->N * X.asDiagonal());
  } else {
    auto& d = get<KroneckerDynamics>(scene.dynamics);
    d.along.diffusivity *= time;
    d.across.diffusivity *= time;
    for (SecondDifference& beside : d.beside) beside.diffusivity *= time;
    d.b *= time * Y[0] / X[0];
    d.n *= X[0] / W[0];
  }
  if (auto* dense = std::get_if<Matrix>(&scene.M)) {
    *dense = W.cwiseInverse().asDiagonal() * *dense * Y.asDiagonal();
  } else {
    Tridiagonal& t = std::get<Tridiagonal>(scene.M);
    for (Index i = 0; i < t.diagonal.size(); ++i) {
      t.diagonal[i] *= Y[i] / W[i];
      if (i > 0) t.lower[i] *= Y[i - 1] / W[i];
      if (i + 1 < t.diagonal.size()) t.upper[i] *= Y[i + 1] / W[i];
    }
  }
  if (scene.f_entry == SourceEntry::through_F) {
    scene.F = SparseMatrix(X.cwiseInverse().asDiagonal() * SparseMatrix(time * scene.F));
    scene.f = in_other_units(scene.f, Vector::Ones(scene.F.cols()), time);
  } else if (scene.f_entry == SourceEntry::through_B) {
    scene.f = in_other_units(scene.f, Y, time);
  } else {
    scene.f = in_other_units(scene.f, X / time, time);
  }
  scene.g = in_other_units(scene.g, W, time);
  for (double& t : scene.breakpoints) t /= time;
  if (scene.boundary) {
    scene.boundary->E0 *= X.asDiagonal();
    scene.boundary->ET *= X.asDiagonal();
  } else {
    scene.x0 = scene.x0.cwiseQuotient(X);
  }
  scene.T /= time;
  scene.port = {};
  scene.exact = {};
  return scene;
}

}  // namespace bromwich::oracle
