#include "tests/support/engineering_scene.hpp"

#include "tests/support/random_draws.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace bromwich::oracle {
namespace {

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

std::string matrix(const Matrix& M) {
  std::string text = "[";
  for (Index i = 0; i < M.rows(); ++i) {
    text += i > 0 ? ",\n     [" : "[";
    for (Index j = 0; j < M.cols(); ++j) text += (j > 0 ? ", " : "") + number(M(i, j));
    text += "]";
  }
  return text + "]";
}

std::string vector(const Vector& v) {
  std::string text = "[";
  for (Index i = 0; i < v.size(); ++i) text += (i > 0 ? ", " : "") + number(v[i]);
  return text + "]";
}

std::string sums(const Matrix& factors, const std::vector<TimeSignal>& signals) {
  std::string text = "[";
  for (Index i = 0; i < factors.rows(); ++i) {
    std::string sum;
    for (Index k = 0; k < factors.cols(); ++k) {
      if (factors(i, k) == 0) continue;
      sum += (sum.empty() ? "" : " + ") + number(factors(i, k));
      if (signals[std::size_t(k)].kind != TimeSignal::Kind::constant) sum += "*" + signals[std::size_t(k)].text();
    }
    text += (i > 0 ? ", \"" : "\"") + (sum.empty() ? "0" : sum) + "\"";
  }
  return text + "]";
}

std::vector<Index> shuffled(Draw& draw, Index n) {
  std::vector<Index> order(std::size_t(n), 0);
  std::iota(order.begin(), order.end(), Index(0));
  for (Index i = n - 1; i > 0; --i) std::swap(order[std::size_t(i)], order[std::size_t(draw.index(0, i))]);
  return order;
}

Matrix permutation(Draw& draw, Index n) {
  const Matrix one = Matrix::Identity(n, n);
  return one(shuffled(draw, n), Eigen::all);
}

Matrix decades(Draw& draw, Index n) {
  return Vector::NullaryExpr(n, [&] { return std::pow(10, double(draw.index(-3, 3))); }).asDiagonal();
}

}  // namespace

double TimeSignal::value(double t) const {
  switch (kind) {
    case Kind::constant:
      return 1;
    case Kind::sine:
      return std::sin(a * t + b);
    case Kind::pulse:
      return t - a - b * std::floor((t - a) / b) < c ? 1 : 0;
    case Kind::step:
      return t < a ? 0 : 1;
  }
  return 0;
}

std::string TimeSignal::text() const {
  switch (kind) {
    case Kind::constant:
      return "1";
    case Kind::sine:
      return "sin(" + number(a) + "*t + " + number(b) + ")";
    case Kind::pulse:
      return "pulse(t - " + number(a) + ", " + number(b) + ", " + number(c) + ")";
    case Kind::step:
      return "(t < " + number(a) + " ? 0 : 1)";
  }
  return "";
}

std::string scene_file(const EngineeringScene& s, bool periodic) {
  const Index m = s.states();
  std::string text = "name = \"" + s.name + "\"\n[dynamics]\nA = " + matrix(s.A) + "\nB = " + matrix(s.B) +
                     "\nf = " + sums(s.F, s.signals) + "\n";
  if (periodic)
    text += "[boundary]\nE0 = \"identity\"\nET = \"identity(" + std::to_string(m) +
            ", -1)\"\nb = " + vector(Vector::Zero(m)) + "\n";
  else
    text += "x0 = " + vector(s.x0) + "\n";
  return text + "[complementarity]\nN = " + matrix(s.N) + "\nM = " + matrix(s.M) + "\ng = " + sums(s.G, s.signals) +
         "\n[time]\nT = " + number(periodic ? s.period : s.T) + "\n[output]\nstates = \"all\"\n";
}

const char* to_string(Telling telling) {
  static constexpr const char* names[] = {"original", "mirrored", "permuted", "other units"};
  return names[int(telling)];
}

Retold retold(const EngineeringScene& s, Telling telling, std::uint32_t seed) {
  Draw draw(seed + 4242);
  const Index m = s.states(), n = s.constraints();
  Matrix P = Matrix::Identity(m, m), Q = Matrix::Identity(n, n), R = Q;  // x = P x', y = Q y', w' = R w
  Retold made{s, {}, 1};
  if (telling == Telling::mirrored) P = -P;
  if (telling == Telling::permuted) P = permutation(draw, m), Q = permutation(draw, n), R = Q.transpose();
  if (telling == Telling::other_units) {
    P = decades(draw, m), Q = decades(draw, n), R = decades(draw, n);
    made.time = std::pow(10, double(draw.index(-3, 3)));
  }
  const Matrix inverse =
      telling == Telling::other_units ? Matrix(P.diagonal().cwiseInverse().asDiagonal()) : Matrix(P.transpose());
  EngineeringScene& r = made.scene;
  r.A = made.time * inverse * s.A * P, r.B = made.time * inverse * s.B * Q, r.F = made.time * inverse * s.F;
  r.N = R * s.N * P, r.M = R * s.M * Q, r.G = R * s.G;
  r.x0 = inverse * s.x0, r.weight = (P.transpose() * s.weight).cwiseAbs();
  r.T /= made.time, r.period /= made.time;
  for (TimeSignal& signal : r.signals) {
    if (signal.kind == TimeSignal::Kind::sine) {
      signal.a *= made.time;
    } else {
      signal.a /= made.time, signal.b /= made.time, signal.c /= made.time;
    }
  }
  made.to_original = P;
  return made;
}

}  // namespace bromwich::oracle
