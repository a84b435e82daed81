#include "core/scene/relay.hpp"

#include "core/base/error.hpp"

namespace bromwich {

namespace {

std::string shape(const Matrix& matrix) {
  return std::to_string(matrix.rows()) + " x " + std::to_string(matrix.cols());
}

}  // namespace

Scene relay_scene(const Matrix& A, const Matrix& B, const Matrix& C, const TimeFunction& f, const Vector& x0,
                  const TimeFunction& e, const TimeFunction& bound) {
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
  const auto bounds = [k, bound](double t) {
    Vector b = Vector::Ones(k);
    if (bound) bound(t, b);
    return b;
  };
  scene.f = [f, B, bounds](double t, Eigen::Ref<Vector> value) {
    value.setZero();
    if (f) f(t, value);
    value += B * bounds(t);
  };
  scene.g = [k, e, bounds](double t, Eigen::Ref<Vector> g) {
    g.setZero();
    if (e) e(t, g.head(k));
    g = -g;
    g.tail(k) = bounds(t);
  };
  scene.relays = k;
  scene.x0 = x0;
  return scene;
}

Scene with_pairs(Scene relays, const Matrix& B, const Matrix& N, const Matrix& M, const TimeFunction& g) {
  const DenseDynamics& of_relays = *relays.dynamics->small_state();
  const Index m = relays.states(), k = relays.constraints(), n = N.rows();
  if (N.cols() != m)
    throw Error("N", "is " + shape(N), "make it constraints x states, with " + std::to_string(m) + " columns");
  if (B.rows() != m || B.cols() != n)
    throw Error("B", "has " + std::to_string(B.cols()) + " columns for y",
                "give one for each of the " + std::to_string(n) + " rows of N");
  if (M.rows() != n || M.cols() != n)
    throw Error("M", "is " + shape(M), "make it " + std::to_string(n) + " x " + std::to_string(n));
  DenseDynamics both{of_relays.A, Matrix(m, k + n), Matrix(k + n, m), of_relays.E};
  both.B << of_relays.B, B;
  both.N << of_relays.N, N;
  Matrix stacked = Matrix::Zero(k + n, k + n);
  stacked.topLeftCorner(k, k) = std::get<Matrix>(relays.M);
  stacked.bottomRightCorner(n, n) = M;
  relays.dynamics = std::move(both);
  relays.M = std::move(stacked);
  relays.lcp_class = LcpClass::automatic;
  relays.g = [of_relays = relays.g, g, k, n](double t, Eigen::Ref<Vector> value) {
    value.setZero();
    of_relays(t, value.head(k));
    if (g) g(t, value.tail(n));
  };
  return relays;
}

}  // namespace bromwich
