#include "core/scene/relay.hpp"

#include "core/base/error.hpp"

namespace bromwich {

namespace {

std::string shape(const Matrix& matrix) {
  return std::to_string(matrix.rows()) + " x " + std::to_string(matrix.cols());
}

}  // namespace

Scene relay_scene(const Matrix& A, const Matrix& B, const Matrix& C, const TimeFunction& f, const Vector& x0,
                  const TimeFunction& e) {
  const Index m = A.rows(), k = C.rows();
  if (A.cols() != m) throw Error("A", "is " + shape(A), "make it square, states x states");
  if (C.cols() != m) throw Error("C", "is " + shape(C), "make it relays x states, with as many states as A has rows");
  if (B.rows() != m || B.cols() != k)
    throw Error("B", "is " + shape(B), "make it states x relays = " + std::to_string(m) + " x " + std::to_string(k));
  DenseDynamics dynamics{A, Matrix::Zero(m, 2 * k), Matrix::Zero(2 * k, m)};
  dynamics.B.leftCols(k) = -2 * B;
  dynamics.N.topRows(k) = -C;
  Matrix M = Matrix::Zero(2 * k, 2 * k);
  M.topRightCorner(k, k).setIdentity();
  M.bottomLeftCorner(k, k) = -Matrix::Identity(k, k);
  Scene scene;
  scene.dynamics = std::move(dynamics);
  scene.M = std::move(M);
  scene.lcp_class = LcpClass::PSD;
  scene.f = [f, on = Vector(B.rowwise().sum())](double t, Eigen::Ref<Vector> value) {
    value.setZero();
    if (f) f(t, value);
    value += on;
  };
  scene.g = [k, e](double t, Eigen::Ref<Vector> g) {
    g.setZero();
    if (e) e(t, g.head(k));
    g = -g;
    g.tail(k).setOnes();
  };
  scene.relays = k;
  scene.x0 = x0;
  return scene;
}

}  // namespace bromwich
