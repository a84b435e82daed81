// Derivatives of converters whose coil carries no current for a part of each period: by every parameter, against
// differences of the three linear modes, with the end of the current located by bisection.

#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "derivatives/parameter_derivative.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace bromwich::discontinuous_test {
namespace {

using Parameters = std::map<std::string, double>;

constexpr double first_edge = 0.1, T = 2.8;  // the gate is open from there to `off` in each period of length 1

// The linear modes of z = (x, integral of the diode current, 1), and the current of the diode in the second one.
struct Modes {
  Matrix on, off, idle;
  Eigen::RowVectorXd diode;
};

struct Converter {
  std::string name;
  Parameters given;
  std::function<Scene(const Parameters&)> scene;
  std::function<Modes(const Parameters&)> modes;
};

TimeFunction constant(const Vector& values) {
  return [values](double, Eigen::Ref<Vector> v) { v = values; };
}

// y = (current of the diode, p, q) as in examples/boost.toml: a switch whose current lies between 0 and I_max u(t).
Scene gated(Parameters p, const Matrix& A, const Matrix& B, const Matrix& N, const Matrix& M, const Vector& f,
            double voltage, const Vector& x0) {
  Scene s;
  s.dynamics = DenseDynamics{A, B, N};
  s.M = M;
  s.lcp_class = LcpClass::PSD;
  s.f = constant(f);
  s.g = [voltage, off = p["off"], most = p["I_max"]](double t, Eigen::Ref<Vector> v) {
    const double phase = t - std::floor(t);
    v << voltage, (phase >= first_edge && phase < off ? most : 0), 0;
  };
  s.x0 = x0;
  s.T = T;
  for (int period = 0; period < 3; ++period)
    s.breakpoints.insert(s.breakpoints.end(), {period + first_edge, period + p["off"]});
  s.breakpoints_are_all = true;
  return s;
}

Matrix with_diode(const Matrix& of_x, const Vector& by_source, const Eigen::RowVectorXd& diode) {
  const Index m = of_x.rows();
  Matrix all = Matrix::Zero(m + 2, m + 2);
  all.topLeftCorner(m, m) = of_x;
  all.topRightCorner(m, 1) = by_source;
  if (diode.size() > 0) all.row(m).head(m) = diode;
  return all;
}

const Matrix of_switch{{0, -1, 1}, {1, 0, 0}, {-1, 0, 0}};

// Ron: resistance of the diode.
Converter boost() {
  return {"boost",
          {{"Vin", 1}, {"L", 0.2}, {"C", 5}, {"R", 20}, {"Ron", 0.05}, {"off", 0.4}, {"I_max", 100}},
          [](Parameters p) {
            const double L = p["L"], C = p["C"];
            return gated(p, Matrix{{0, 0}, {0, -1 / (p["R"] * C)}}, Matrix{{0, -1 / L, 1 / L}, {1 / C, 0, 0}},
                         Matrix{{0, 1}, {-1, 0}, {1, 0}}, Matrix{{p["Ron"], -1, 1}, {1, 0, 0}, {-1, 0, 0}},
                         Vector{{p["Vin"] / L, 0}}, 0, Vector{{0, 2}});
          },
          [](Parameters p) {
            const double L = p["L"], C = p["C"], decay = -1 / (p["R"] * C);
            const Vector source{{p["Vin"] / L, 0}}, none{{0, 0}};
            const Eigen::RowVector2d diode(1, 0);
            return Modes{with_diode(Matrix{{0, 0}, {0, decay}}, source, {}),
                         with_diode(Matrix{{-p["Ron"] / L, -1 / L}, {1 / C, decay}}, source, diode),
                         with_diode(Matrix{{0, 0}, {0, decay}}, none, {}), diode};
          }};
}

Converter buck() {
  return {"buck",
          {{"Vin", 2}, {"L", 0.2}, {"C", 5}, {"R", 4}, {"off", 0.35}, {"I_max", 100}},
          [](Parameters p) {
            const double L = p["L"], C = p["C"];
            return gated(p, Matrix{{0, -1 / L}, {1 / C, -1 / (p["R"] * C)}}, Matrix{{0, -1 / L, 1 / L}, {0, 0, 0}},
                         Matrix{{0, 0}, {-1, 0}, {1, 0}}, of_switch, Vector{{p["Vin"] / L, 0}}, p["Vin"],
                         Vector{{0, 1}});
          },
          [](Parameters p) {
            const double L = p["L"], C = p["C"], decay = -1 / (p["R"] * C);
            const Vector source{{p["Vin"] / L, 0}}, none{{0, 0}};
            const Eigen::RowVector2d diode(1, 0);
            const Matrix coil{{0, -1 / L}, {1 / C, decay}};
            return Modes{with_diode(coil, source, {}), with_diode(coil, none, diode),
                         with_diode(Matrix{{0, 0}, {0, decay}}, none, {}), diode};
          }};
}

// n: windings of the output over those of the input; it enters M.
Converter flyback() {
  return {"flyback",
          {{"Vin", 1}, {"L", 0.2}, {"C", 5}, {"R", 10}, {"n", 0.5}, {"off", 0.45}, {"I_max", 100}},
          [](Parameters p) {
            const double L = p["L"], C = p["C"], n = p["n"];
            return gated(p, Matrix{{0, 0}, {0, -1 / (p["R"] * C)}}, Matrix{{0, -1 / L, 1 / L}, {1 / C, 0, 0}},
                         Matrix{{0, 1}, {-1, 0}, {1, 0}}, Matrix{{0, -n, n}, {n, 0, 0}, {-n, 0, 0}},
                         Vector{{p["Vin"] / L, 0}}, n * p["Vin"], Vector{{0, 1}});
          },
          [](Parameters p) {
            const double L = p["L"], C = p["C"], n = p["n"], decay = -1 / (p["R"] * C);
            const Vector source{{p["Vin"] / L, 0}}, none{{0, 0}};
            const Eigen::RowVector2d diode(1 / n, 0);
            return Modes{with_diode(Matrix{{0, 0}, {0, decay}}, source, {}),
                         with_diode(Matrix{{0, -1 / (n * L)}, {1 / (n * C), decay}}, none, diode),
                         with_diode(Matrix{{0, 0}, {0, decay}}, none, {}), diode};
          }};
}

// In the third mode both coils carry the same current.
Converter cuk() {
  return {
      "cuk",
      {{"Vin", 1}, {"L1", 0.3}, {"L2", 0.45}, {"C1", 2}, {"C2", 5}, {"R", 12}, {"off", 0.35}, {"I_max", 100}},
      [](Parameters p) {
        const double L1 = p["L1"], L2 = p["L2"], C1 = p["C1"], C2 = p["C2"];
        const Matrix A{{0, 0, 0, 0}, {0, 0, 1 / C1, 0}, {0, -1 / L2, 0, -1 / L2}, {0, 0, 1 / C2, -1 / (p["R"] * C2)}};
        const Matrix B{{0, -1 / L1, 1 / L1}, {1 / C1, 0, 0}, {0, 1 / L2, -1 / L2}, {0, 0, 0}};
        return gated(p, A, B, Matrix{{0, 1, 0, 0}, {-1, 0, 1, 0}, {1, 0, -1, 0}}, of_switch,
                     Vector{{p["Vin"] / L1, 0, 0, 0}}, 0, Vector{{0.1, 2, 0.1, -1}});
      },
      [](Parameters p) {
        const double L1 = p["L1"], L2 = p["L2"], C1 = p["C1"], C2 = p["C2"], decay = -1 / (p["R"] * C2);
        const Vector source{{p["Vin"] / L1, 0, 0, 0}}, none = Vector::Zero(4);
        const Eigen::RowVector4d diode(1, 0, -1, 0);
        const double both = L1 + L2;  // i1' = i2' = (Vin - v1 - v2)/(L1 + L2)
        return Modes{
            with_diode(Matrix{{0, 0, 0, 0}, {0, 0, 1 / C1, 0}, {0, -1 / L2, 0, -1 / L2}, {0, 0, 1 / C2, decay}}, source,
                       {}),
            with_diode(Matrix{{0, -1 / L1, 0, 0}, {1 / C1, 0, 0, 0}, {0, 0, 0, -1 / L2}, {0, 0, 1 / C2, decay}}, source,
                       diode),
            with_diode(Matrix{{0, -1 / both, 0, -1 / both},
                              {0, 0, 1 / C1, 0},
                              {0, -1 / both, 0, -1 / both},
                              {0, 0, 1 / C2, decay}},
                       Vector{{p["Vin"] / both, 0, p["Vin"] / both, 0}}, {}),
            diode};
      }};
}

struct Followed {
  std::vector<Vector> z;  // at the times
  int idle = 0;           // intervals without current up to the last one
};

// (x, integral of the diode current, 1) at increasing times, up to `end`.
Followed follow(const Converter& c, Parameters p, const Vector& x0, const Vector& times, double end = T) {
  const Modes modes = c.modes(p);
  Vector z(x0.size() + 2);
  z << x0, 0, 1;
  const auto current = [&](const Vector& at) { return modes.diode.dot(at.head(x0.size())); };
  const Matrix* mode = &modes.idle;
  Followed found;
  double t = 0;
  Index row = 0;
  const auto advance = [&](double to) {
    for (; row < times.size() && times[row] <= to; ++row)
      found.z.push_back(oracle::exponential(Matrix(*mode * (times[row] - t))) * z);
    z = (oracle::exponential(Matrix(*mode * (to - t))) * z).eval();
    t = to;
  };
  for (int period = 0; period + first_edge < end; ++period) {
    advance(period + first_edge);
    mode = &modes.on;
    advance(period + p["off"]);
    mode = &modes.off;
    const double until = std::min(end, period + 1 + first_edge);
    const auto after = [&](double to) { return current(oracle::exponential(Matrix(modes.off * (to - t))) * z); };
    double low = t, high = until;
    if (after(until) < 0) {
      for (int i = 0; i < 60; ++i) (after((low + high) / 2) > 0 ? low : high) = (low + high) / 2;
      advance(high);
      mode = &modes.idle;
      ++found.idle;
    }
    advance(until);
  }
  return found;
}

class DiscontinuousConduction : public ::testing::TestWithParam<Converter> {};

TEST_P(DiscontinuousConduction, HasDerivativesByEveryParameter) {
  const Converter& c = GetParam();
  const auto backend = make_cpu_backend(1);
  Options options;
  options.method = Method::events;
  options.steps = 28;
  options.states = StateSelection::all;
  const Scene scene = c.scene(c.given);
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const Followed at = follow(c, c.given, scene.x0, result.t);
  ASSERT_EQ(at.idle, 3) << "the coil carries no current at the end of each period";
  const Index m = scene.states(), last = result.t.size() - 1;
  for (const auto& [name, value] : c.given) {
    SCOPED_TRACE(c.name + " by " + name);
    const auto with = [&](double v) {
      Parameters p = c.given;
      p[name] = v;
      return p;
    };
    const VariedParameter by{name, value, [&](double v) { return ParameterScene{c.scene(with(v))}; }};
    const ParameterDerivative d(scene, result, *backend, {by}, true);
    const SolutionChange change = d.jvp(0);
    // Second differences err by step^2 or 1e-10 of the values; data that are linear between rows by 1e-7.
    const double step = 1e-5 * value;
    const Followed up = follow(c, with(value + step), scene.x0, result.t),
                   down = follow(c, with(value - step), scene.x0, result.t);
    double size = 1e-3 / value;
    for (Index j = 0; j <= last; ++j)
      size = std::max(size, ((up.z[std::size_t(j)] - down.z[std::size_t(j)]) / (2 * step)).cwiseAbs().maxCoeff());
    for (Index j = 0; j <= last; ++j) {
      if (std::find(d.one_sided().begin(), d.one_sided().end(), j) != d.one_sided().end()) continue;
      const Vector expected = (up.z[std::size_t(j)] - down.z[std::size_t(j)]) / (2 * step);
      EXPECT_LE((change.x.row(j).transpose() - expected.head(m)).cwiseAbs().maxCoeff(), 1e-6 * size) << j;
      EXPECT_NEAR(change.integral(j, 0), expected[m], 1e-6 * size) << j;
    }
    SolutionChange of;
    of.x = RowMatrix::Zero(last + 1, m);
    of.x(last, m - 1) = 1;
    EXPECT_NEAR(d.vjp(of)[0], change.x(last, m - 1), 1e-12 * size) << "the gradient";
  }
}

// The same over one period that repeats. A has a zero mode where the coil is ideal, which its diode fixes.
Scene repeated(Scene s, double off) {
  const Index m = s.states();
  s.T = 1;
  s.x0.resize(0);
  s.boundary = BoundaryCondition{Matrix::Identity(m, m), -Matrix::Identity(m, m), Vector::Zero(m)};
  s.breakpoints = {first_edge, off};
  return s;
}

Vector after_period(const Converter& c, const Parameters& p, const Vector& x0) {
  return follow(c, p, x0, Vector{{1}}, 1).z.front().head(x0.size());
}

// Column k by x0_k, by central differences.
Matrix differences(const Converter& c, const Parameters& p, const Vector& x0) {
  constexpr double step = 1e-5;
  Matrix D(x0.size(), x0.size());
  for (Index k = 0; k < x0.size(); ++k) {
    const Vector by = step * Vector::Unit(x0.size(), k);
    D.col(k) = (after_period(c, p, x0 + by) - after_period(c, p, x0 - by)) / (2 * step);
  }
  return D;
}

TEST_P(DiscontinuousConduction, HasPeriodicStatesWithDerivatives) {
  const Converter& c = GetParam();
  const auto backend = make_cpu_backend(1);
  Options options;
  options.steps = 20;
  options.states = StateSelection::all;
  options.method = Method::shooting;
  const Scene scene = repeated(c.scene(c.given), c.given.at("off"));
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const Vector x0 = result.x.row(0).transpose();
  EXPECT_LE((after_period(c, c.given, x0) - x0).cwiseAbs().maxCoeff(), 1e-8);
  const Index m = scene.states();
  const Matrix open = Matrix::Identity(m, m) - differences(c, c.given, x0);
  for (const auto& [name, value] : c.given) {
    SCOPED_TRACE(c.name + " by " + name);
    const auto with = [&](double v) {
      Parameters p = c.given;
      p[name] = v;
      return p;
    };
    const VariedParameter by{name, value,
                             [&](double v) { return ParameterScene{repeated(c.scene(with(v)), with(v)["off"])}; }};
    const ParameterDerivative d(scene, result, *backend, {by});
    const double step = 1e-5 * value;
    const Vector moved =
        (after_period(c, with(value + step), x0) - after_period(c, with(value - step), x0)) / (2 * step);
    const Vector expected = open.partialPivLu().solve(moved);
    // As above; what differences err by, some rounding of x over the step, grows with the periods that it takes to
    // settle, about a hundred.
    const double size = std::max(1e-3 / value, expected.cwiseAbs().maxCoeff());
    const double rounding = 100 * 4 * epsilon * x0.cwiseAbs().maxCoeff() / step;
    EXPECT_LE((d.jvp(0).x.row(0).transpose() - expected).cwiseAbs().maxCoeff(), 1e-6 * size + rounding);
    SolutionChange of;
    of.x = RowMatrix::Zero(result.t.size(), m);
    of.x(0, m - 1) = 1;
    EXPECT_NEAR(d.vjp(of)[0], d.jvp(0).x(0, m - 1), 1e-10 * size) << "the gradient";
  }
}

INSTANTIATE_TEST_SUITE_P(Converters, DiscontinuousConduction, ::testing::Values(boost(), buck(), flyback(), cuk()),
                         [](const auto& converter) { return converter.param.name; });

}  // namespace
}  // namespace bromwich::discontinuous_test
