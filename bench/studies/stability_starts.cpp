#include "bench/studies/stability_cases.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich::app::hard {

void Catalogue::starts() {
  const std::string group = "starts";
  Scene jump;  // x0 = -1 violates the constraint: the state jumps to 0, then x' = 1 - x
  jump.dynamics = DenseDynamics{-Matrix::Identity(1, 1), Matrix::Ones(1, 1), Matrix::Ones(1, 1)};
  jump.M = Matrix(Matrix::Zero(1, 1));
  jump.f = [](double, Eigen::Ref<Vector> f) { f[0] = 1; };
  jump.x0 = -Vector::Ones(1);
  jump.T = 2;
  jump.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    x[0] = -std::expm1(-t);
    y[0] = 0;
  };
  HardCase& c = add(group, "incompatible x0", jump, "by hand");
  c.y_jumps = true;
  c.impulse = Vector::Ones(1);
  sliding();
  zeno();
  falling();
  braked();
}

// A mass that flies freely meets a rigid stop and loses its velocity.
Scene Catalogue::at_stop(double stiffness, double weight, double T) {
  Scene scene;
  scene.dynamics = DenseDynamics{(Matrix(2, 2) << 0, 1, -stiffness, 0).finished(), (Matrix(2, 1) << 0, 1).finished(),
                                 (Matrix(1, 2) << 1, 0).finished()};
  scene.M = Matrix(Matrix::Zero(1, 1));
  if (weight > 0) scene.f = [=](double, Eigen::Ref<Vector> f) { f << 0, -weight; };
  scene.x0 = Vector::Unit(2, 0);
  scene.T = T;
  return scene;
}

void Catalogue::falling() {
  constexpr double g = 9.81;
  Scene scene = at_stop(0, g, 2);
  scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    const double height = 1 - g * t * t / 2;
    x << std::max(height, 0.0), (height > 0 ? -g * t : 0);
    y.setConstant(NAN);
  };
  add("starts", "ball on a rigid floor", scene, "by hand").compare_y = false;
}

void Catalogue::braked() {
  Scene scene = at_stop(1, 0, 3);
  scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    x << (t < pi / 2 ? std::cos(t) : 0), (t < pi / 2 ? -std::sin(t) : 0);
    y.setConstant(NAN);
  };
  add("starts", "spring against a stop", scene, "by hand").compare_y = false;
}

// x' in -Sgn x: y = (s, the negative part of x), Sgn = 1 - 2 s.
void Catalogue::sliding() {
  Scene scene;
  scene.dynamics =
      DenseDynamics{Matrix::Zero(1, 1), (Matrix(1, 2) << 2, 0).finished(), (Matrix(2, 1) << 1, 0).finished()};
  scene.M = Matrix((Matrix(2, 2) << 0, 1, -1, 0).finished());
  scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = -1; };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 1; };
  scene.x0 = Vector::Ones(1);
  scene.T = 2;
  scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    x[0] = std::max(0.0, 1 - t);
    y << (t < 1 ? 0 : 0.5), 0;
  };
  add("starts", "relay, slides from t = 1", scene, "by hand").y_jumps = true;
}

// Two relays: the state rotates around the origin and reaches it at t = 2 after infinitely many switches.
void Catalogue::zeno() {
  const Matrix turn = 500 * (Matrix(2, 2) << .01, .99, -.99, .01).finished();
  Scene scene;
  Matrix B = Matrix::Zero(2, 4), N = Matrix::Zero(4, 2), M = Matrix::Zero(4, 4);
  B.leftCols(2) = -2 * turn;
  N.topRows(2) = -Matrix::Identity(2, 2);
  M.topRightCorner(2, 2).setIdentity();
  M.bottomLeftCorner(2, 2) = -Matrix::Identity(2, 2);
  scene.dynamics = DenseDynamics{B.rows() == 2 ? Matrix::Zero(2, 2) : Matrix(), B, N};
  scene.M = M;
  scene.f = [turn](double, Eigen::Ref<Vector> f) { f = turn * Vector::Ones(2); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 0, 1, 1; };
  scene.x0 = Vector::Constant(2, 10);
  scene.T = 2.5;
  std::vector<double> times{0};
  std::vector<Vector> corners{scene.x0};
  Vector sign = Vector::Ones(2);  // of x, from a corner on
  while (corners.back().cwiseAbs().maxCoeff() > 1e-12 && times.size() < 5000) {
    const Vector velocity = -turn * sign, x = corners.back();
    const Index i = velocity[0] * sign[0] < 0 ? 0 : 1;
    const double step = -x[i] / velocity[i];
    times.push_back(times.back() + step);
    corners.push_back(x + step * velocity);
    corners.back()[i] = 0;
    sign[i] = -sign[i];
  }
  scene.exact = [=](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    y.setConstant(NAN);
    const std::size_t k = std::size_t(std::upper_bound(times.begin(), times.end(), t) - times.begin());
    if (k == times.size()) {
      x.setZero();
      return;
    }
    const double s = (t - times[k - 1]) / (times[k] - times[k - 1]);
    x = (1 - s) * corners[k - 1] + s * corners[k];
  };
  add("starts", "Zeno, ends at t = 2", scene, "switch by switch").compare_y = false;
}

}  // namespace bromwich::app::hard
