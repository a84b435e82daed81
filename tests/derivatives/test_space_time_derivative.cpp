// Derivatives over all time points at once, on every backend and by every method, against those that step on the host
// and against central differences of solves.

#include "derivatives/space_time_derivative.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/solve/solve.hpp"
#include "derivatives/modal_derivative.hpp"
#include "tests/derivatives/drawn_changes.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/refusal.hpp"

#include <cmath>
#include <string>

namespace bromwich::space_time_test {
namespace {

using namespace derivative_test;

Result solved(const Scene& scene, Index J, Method method, Backend& backend) {
  Options options;
  options.steps = J;
  options.method = method;
  const Result r = solve(scene, backend, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, method);
  return r;
}

SolutionChange drawn_weights(const Scene& s, Index J, unsigned seed) {
  Random random(seed);
  const Index n = s.constraints();
  return {random.matrix(J + 1, n), random.matrix(J + 1, s.states()), random.matrix(J + 1, n), random.matrix(J + 1, n)};
}

void expect_transposed(SpaceTimeDerivative& d, const Scene& s, Index J, const std::string& where) {
  const DataChange c = drawn(s, J, 5);
  const SolutionChange out = d.jvp(c, true), of = drawn_weights(s, J, 6);
  const DataChange bar = d.vjp(of);
  const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w) + dot(of.integral, out.integral);
  const double backward = bar.x0.dot(c.x0) + dot(bar.f, c.f) + dot(bar.g, c.g) + dot(bar.M, c.M);
  const double size = of.y.norm() * out.y.norm() + of.x.norm() * out.x.norm() + of.w.norm() * out.w.norm() +
                      of.integral.norm() * out.integral.norm();
  EXPECT_LE(std::abs(forward - backward), 1e-12 * size) << where;
}

class SpaceTimeDerivatives : public BackendTest {};

// Another program for the same numbers: modes are stepped on the host, with the exponentials that marching fits.
TEST_P(SpaceTimeDerivatives, AreThoseOfTheHost) {
  const Index J = 32;
  for (const char* name : {"signorini", "signorini3d"})
    for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
      const Scene s = warmed(name, std::string(name) == "signorini" ? 9 : 4);
      const std::string where = std::string(name) + " " + to_string(method);
      const Result r = solved(s, J, method, *backend);
      SpaceTimeDerivative d(s, r, *backend);
      const ModalDerivative host(s, r);
      EXPECT_EQ(d.method(), method);
      EXPECT_EQ(d.steps(), J);
      EXPECT_NEAR(d.margin().margin, host.margin().margin, 1e-9);
      const DataChange c = drawn(s, J, 3);
      const SolutionChange a = d.jvp(c, true), b = host.jvp(c, true);
      // Fitted exponentials differ from the eigenvalues by 1e-11; sweeps end at 1e-12.
      EXPECT_LE((a.y - b.y).norm(), 1e-10 * b.y.norm()) << where;
      EXPECT_LE((a.x - b.x).norm(), 1e-10 * b.x.norm()) << where;
      EXPECT_LE((a.w - b.w).norm(), 1e-10 * b.w.norm()) << where;
      EXPECT_LE((a.integral - b.integral).norm(), 1e-10 * b.integral.norm()) << where;
      const SolutionChange of = drawn_weights(s, J, 4);
      const DataChange u = d.vjp(of), v = host.vjp(of);
      EXPECT_LE((u.x0 - v.x0).norm(), 1e-10 * v.x0.norm()) << where;
      EXPECT_LE((u.f - v.f).norm(), 1e-10 * v.f.norm()) << where;
      EXPECT_LE((u.g - v.g).norm(), 1e-10 * v.g.norm()) << where;
      EXPECT_LE((u.M - v.M).norm(), 1e-10 * v.M.norm()) << where;
      expect_transposed(d, s, J, where);
    }
}

TEST_P(SpaceTimeDerivatives, OfDenseAndSparseDynamics) {
  const Index J = 32;
  const Scene line = warmed("signorini", 9);
  const Scene dense = written_out(line);
  Scene sparse = line;
  sparse.dynamics = to_sparse(get<KroneckerDynamics>(line.dynamics));
  const Matrix B = dense.dynamics->small_state()->B;
  for (const bool is_dense : {true, false}) {
    const Scene& s = is_dense ? dense : sparse;
    const std::string where = is_dense ? "dense" : "sparse";
    const Result r = solved(dense, J, Method::march, *backend);
    SpaceTimeDerivative d(s, r, *backend);
    const SolutionDerivative host(dense, r);
    DataChange c = drawn(s, J, 3), written = c;
    written.f = c.f * B.transpose();
    const SolutionChange a = d.jvp(c, true), b = host.jvp(written);
    const double exact = is_dense ? 1e-10 : 1e-8;  // of contours, which are accepted at 1e-9 of the largest weight
    EXPECT_LE((a.y - b.y).norm(), exact * b.y.norm()) << where;
    EXPECT_LE((a.x - b.x).norm(), exact * b.x.norm()) << where;
    EXPECT_LE((a.w - b.w).norm(), exact * b.w.norm()) << where;
    const SolutionChange of = drawn_weights(s, J, 4);
    const DataChange u = d.vjp(of), v = host.vjp(of);
    EXPECT_LE((u.x0 - v.x0).norm(), exact * v.x0.norm()) << where;
    EXPECT_EQ(d.vjp(of, false).x0.size(), 0);
    EXPECT_LE((u.f - v.f * B).norm(), exact * (v.f * B).norm()) << where;
    EXPECT_LE((u.g - v.g).norm(), exact * v.g.norm()) << where;
    EXPECT_LE((u.M - v.M).norm(), exact * v.M.norm()) << where;
    expect_transposed(d, s, J, where);
  }
}

INSTANTIATE_TEST_SUITE_P(Backends, SpaceTimeDerivatives, testing::ValuesIn(backend_cases()), backend_case_name);

// A matrix M that is not symmetric, and a sparse A that the dense derivatives do not take.
TEST(SpaceTimeDerivative, AgreesWithDifferencesOfSolves) {
  const Index J = 48;
  const auto backend = make_cpu_backend(2);
  Scene s = warmed("signorini", 33, 0.5);
  s.dynamics = to_sparse(get<KroneckerDynamics>(s.dynamics));
  Matrix M = to_dense(s.M);
  for (Index i = 1; i < M.rows(); ++i) M(i, i - 1) = 0.2 * M(i, i);
  s.M = M;
  SpaceTimeDerivative d(s, solved(s, J, Method::march, *backend), *backend);
  EXPECT_NE(refusal([&] { SolutionDerivative(s, solved(s, J, Method::march, *backend)); }).find("1000 states"),
            std::string::npos);
  ASSERT_GT(d.margin().margin, 1e-8);
  const DataChange all = drawn(s, J, 9);
  for (int member = 0; member < 4; ++member) {
    DataChange c;
    if (member == 0) c.x0 = all.x0;
    if (member == 1) c.f = all.f;
    if (member == 2) c.g = all.g;
    if (member == 3) c.M = all.M;
    const SolutionChange out = d.jvp(c);
    // The sets stay within the step; rounding of the solves over the step is left of the difference.
    const double step = 0.2 * d.margin().margin / (1 + out.y.cwiseAbs().maxCoeff() + out.w.cwiseAbs().maxCoeff());
    const RowMatrix y = (solved(changed(s, c, step), J, Method::march, *backend).y -
                         solved(changed(s, c, -step), J, Method::march, *backend).y) /
                        (2 * step);
    EXPECT_LE((out.y - y).cwiseAbs().maxCoeff(), 1e-6 * y.cwiseAbs().maxCoeff() + 1e-13 / step) << member;
  }
}

// So many steps that solves take few poles for the kernel where they fit. The derivative takes lag weights.
TEST(SpaceTimeDerivative, OfSparseDynamicsThatAreSolvedByFewPoles) {
  const Index J = 1024;
  const auto backend = make_cpu_backend(2);
  const Scene modes = warmed("signorini", 33, 0.5);
  Scene sparse = modes;
  sparse.dynamics = to_sparse(get<KroneckerDynamics>(modes.dynamics));
  const Result r = solved(sparse, J, Method::march, *backend);
  EXPECT_TRUE(poles_pay(discretise(sparse, *backend, J)));
  SpaceTimeDerivative d(sparse, r, *backend);
  const ModalDerivative exact(modes, solved(modes, J, Method::march, *backend));
  const DataChange c = drawn(sparse, J, 3);
  const SolutionChange a = d.jvp(c), b = exact.jvp(c);
  EXPECT_LE((a.y - b.y).norm(), 1e-8 * b.y.norm());
  SolutionChange of;
  of.y = Random(4).matrix(J + 1, 33);
  const DataChange u = d.vjp(of), v = exact.vjp(of);
  EXPECT_LE((u.x0 - v.x0).norm(), 1e-8 * v.x0.norm());
  EXPECT_LE((u.f - v.f).norm(), 1e-8 * v.f.norm());
  const double backward = u.x0.dot(c.x0) + dot(u.f, c.f) + dot(u.g, c.g) + dot(u.M, c.M);
  EXPECT_NEAR(dot(of.y, a.y), backward, 1e-12 * of.y.norm() * a.y.norm());
}

TEST(SpaceTimeDerivative, Refuses) {
  const auto backend = make_cpu_backend(1);
  const Scene s = warmed("signorini", 5);
  const Index J = 16;
  const Result r = solved(s, J, Method::march, *backend);
  SpaceTimeDerivative d(s, r, *backend);
  const auto of_change = [&](auto set) {
    DataChange c;
    set(c);
    return refusal([&] { d.jvp(c); });
  };
  EXPECT_NE(of_change([](DataChange& c) { c.A = Matrix::Zero(25, 25); }).find("no datum"), std::string::npos);
  EXPECT_NE(of_change([](DataChange& c) { c.x0 = Vector::Zero(24); }).find("give 25 x 1"), std::string::npos);
  DataChange ends;
  ends.b = Vector::Zero(25);
  for (const std::string& found : {refusal([&] { d.jvp(ends); }), refusal([&] { ModalDerivative(s, r).jvp(ends); }),
                                   refusal([&] { SolutionDerivative(written_out(s), r).jvp(ends); })})
    EXPECT_NE(found.find("change x0"), std::string::npos);
  SolutionChange of;
  of.x = RowMatrix::Zero(J + 1, 24);
  EXPECT_NE(refusal([&] { d.vjp(of); }).find("give 17 x 25"), std::string::npos);
  const auto of_result = [&](auto set) {
    Scene other = s;
    Result result = r;
    set(other, result);
    return refusal([&] { SpaceTimeDerivative(other, result, *backend); });
  };
  EXPECT_NE(of_result([](Scene&, Result& x) { x.y *= 1.01; }).find("do not give y"), std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.status = Status::infeasible; }).find("not solved"), std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.method = Method::euler; }).find("method euler"), std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.continuous = false; }).find("may jump"), std::string::npos);
  EXPECT_NE(of_result([](Scene& x, Result&) { x.f_entry = SourceEntry::state; }).find("through B"), std::string::npos);
  EXPECT_NE(of_result([](Scene& x, Result&) { x.free_rows = {0}; }).find("free rows"), std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.y = x.y.topRows(4).eval(); }).find("other rows"), std::string::npos);
  EXPECT_NE(of_result([](Scene& x, Result&) { x.boundary.emplace(); }).find("boundary"), std::string::npos);
}

TEST(SpaceTimeDerivative, PaysWhereABackendSaysSo) {
  const auto cpu = make_cpu_backend(1);
  Result r;
  r.steps = 400;
  EXPECT_FALSE(space_time_pays(*cpu, make_scene("signorini", {{"Q", 127}}), r));
}

}  // namespace
}  // namespace bromwich::space_time_test
