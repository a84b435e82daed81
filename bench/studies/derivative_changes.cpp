#include "bench/studies/derivative_changes.hpp"

#include "core/scene/separable.hpp"

#include <tuple>

namespace bromwich::app {

namespace {

double size_of(const Eigen::Ref<const Matrix>& values) {
  const double largest = values.size() > 0 ? values.cwiseAbs().maxCoeff() : 0;
  return largest > 0 ? largest : 1;
}

// The change of a source over [0, T] and the same at time points.
struct Ramp {
  Vector start, slope;
  double T;

  RowMatrix rows(const Vector& t) const {
    return RowMatrix(Vector::Ones(t.size()) * start.transpose() + t / T * slope.transpose());
  }
  TimeFunction added_to(const TimeFunction& given, double by, const Matrix& entry) const {
    return [ramp = *this, given, by, entry](double t, Eigen::Ref<Vector> v) {
      if (given && entry.size() > 0) {
        Vector phi(entry.cols());
        given(t, phi);
        v = entry * phi;
      } else if (given) {
        given(t, v);
      } else {
        v.setZero();
      }
      v += by * (ramp.start + t / ramp.T * ramp.slope);
    };
  }
};

Ramp drawn_ramp(double size, Index width, const Vector& t, Drawing& draw) {
  return {size * draw.matrix(width, 1), size * draw.matrix(width, 1), t[t.size() - 1]};
}

}  // namespace

std::vector<Change> changes_of_any(const Scene& scene, const Vector& t, bool by_B, Drawing& draw) {
  const Index n = scene.constraints();
  std::vector<Change> all(4);
  for (std::size_t i = 0; i < all.size(); ++i) all[i].linear = i < 3;
  const Vector start = size_of(scene.boundary ? scene.boundary->b : scene.x0) * draw.matrix(scene.states(), 1);
  all[0].name = scene.boundary ? "b" : "x0";
  (scene.boundary ? all[0].data.b : all[0].data.x0) = start;
  all[0].scene = [&scene, start](double by) {
    Scene s = scene;
    (s.boundary ? s.boundary->b : s.x0) += by * start;
    return s;
  };
  all[1].name = "f";
  const Matrix entry = by_B || !scene.f || scene.f_entry == SourceEntry::state
                           ? Matrix()
                           : source_matrix(scene, *scene.dynamics->small_state());
  const RowMatrix given = scene.f ? RowMatrix(sample(scene.f, t, scene.sources()).table()) : RowMatrix();
  const double size = entry.size() > 0 ? size_of(given * entry.transpose()) : size_of(given);
  const Ramp of_f = drawn_ramp(size, by_B ? n : scene.states(), t, draw);
  all[1].data.f = of_f.rows(t);
  all[1].scene = [&scene, of_f, entry, by_B](double by) {
    Scene s = scene;
    s.f = of_f.added_to(scene.f, by, entry);
    s.f_entry = by_B ? SourceEntry::through_B : SourceEntry::state;
    s.F = {};
    return s;
  };
  all[2].name = "g";
  const Ramp of_g = drawn_ramp(scene.g && n > 0 ? size_of(sample(scene.g, t, n).table()) : 1, n, t, draw);
  all[2].data.g = of_g.rows(t);
  all[2].scene = [&scene, of_g](double by) {
    Scene s = scene;
    s.g = of_g.added_to(scene.g, by, Matrix());
    return s;
  };
  all[3].name = "M";
  const Matrix M = to_dense(scene.M);
  all[3].data.M = size_of(M) * draw.matrix(n, n);
  if (selects_least(scene.lcp_class))
    all[3].data.M.array() *= (M.array() != 0).cast<double>();  // signs of entries stay
  all[3].scene = [&scene, M, more = all[3].data.M](double by) {
    Scene s = scene;
    s.M = Matrix(M + by * more);
    return s;
  };
  if (n == 0) all.resize(2);
  return all;
}

void add_matrices(const Scene& scene, Drawing& draw, std::vector<Change>& all) {
  struct Member {
    const char* name;
    Matrix DenseDynamics::*of;
    Matrix DataChange::*change;
  };
  for (const Member& m : {Member{"A", &DenseDynamics::A, &DataChange::A},
                          {"B", &DenseDynamics::B, &DataChange::B},
                          {"N", &DenseDynamics::N, &DataChange::N},
                          {"E", &DenseDynamics::E, &DataChange::E}}) {
    const Matrix& given = scene.dynamics->small_state()->*m.of;
    if (given.size() == 0) continue;
    Change c;
    c.name = m.name;
    c.linear = false;
    c.data.*m.change = size_of(given) * draw.matrix(given.rows(), given.cols());
    c.scene = [&scene, of = m.of, more = c.data.*m.change](double by) {
      Scene s = scene;
      DenseDynamics d = *scene.dynamics->small_state();
      d.*of += by * more;
      s.dynamics = std::move(d);
      return s;
    };
    all.push_back(std::move(c));
  }
  if (!scene.boundary) return;
  for (const auto& [name, of, change] :
       {std::tuple("E0", &BoundaryCondition::E0, &DataChange::E0), {"ET", &BoundaryCondition::ET, &DataChange::ET}}) {
    const Matrix& given = (*scene.boundary).*of;
    Change c;
    c.name = name;
    c.linear = false;
    c.data.*change = size_of(given) * draw.matrix(given.rows(), given.cols());
    c.scene = [&scene, of = of, more = c.data.*change](double by) {
      Scene s = scene;
      (*s.boundary).*of += by * more;
      return s;
    };
    all.push_back(std::move(c));
  }
}

}  // namespace bromwich::app
