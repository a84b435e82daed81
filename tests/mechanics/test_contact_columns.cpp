// Friction and states of contacts at rows, beside Coulomb's law by the velocities there.

#include "core/solve/dense_output.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

constexpr double V = 0.4, mu = 0.4;  ///< of belt()

TEST(ContactColumns, FollowCoulombsLaw) {
  const Mechanism m = make_mechanism(block(1.3, 10), {belt(0.5)});
  const Result r = located(m.scene);
  const std::vector<ContactColumn> columns = contact_columns(m, contact_report(m, r), r.t, r.x, r.y);
  ASSERT_EQ(columns.size(), 2u);
  EXPECT_EQ(contact_column_names(m), (std::vector<std::string>{"c0.lt", "c0.state"}));
  Index rows_of[3] = {0, 0, 0};
  for (Index j = 1; j < r.t.size(); ++j) {
    const double gap = r.x(j, 1), sliding = r.x(j, 2) - V, normal = r.y(j, 0);
    const double lt = columns[0].values[j], state = columns[1].values[j];
    ++rows_of[std::size_t(state)];
    // Events are located to 1e-10, and forces are about 1.
    if (state == 0) EXPECT_NEAR(lt, 0, 1e-9) << r.t[j];
    if (state > 0) EXPECT_NEAR(gap, 0, 1e-9) << r.t[j];
    if (state == 1) EXPECT_NEAR(sliding, 0, 1e-9) << r.t[j];
    if (state == 2) EXPECT_NEAR(lt, sliding > 0 ? -mu * normal : mu * normal, 1e-9) << r.t[j];
    EXPECT_LE(std::abs(lt), mu * normal + 1e-9) << r.t[j];
  }
  for (const Index rows : rows_of) EXPECT_GT(rows, 10);
}

TEST(ContactColumns, AtOtherTimesAndFromTheRowsOfMarch) {
  const Mechanism m = make_mechanism(block(1.3, 10), {belt()});
  const std::vector<double> times{0.5, 3.3, 7.7};
  const auto backend = make_cpu_backend(1);
  const Result exact = located(m.scene), rows = run(m.scene, marched(4000));
  for (const Result* r : {&exact, &rows}) {
    const Result at = at_times(m.scene, *backend, *r, times);
    const auto columns = contact_columns(m, contact_report(m, *r), at.t, at.x, at.y);
    ASSERT_EQ(columns[1].values.size(), 3);
    for (Index k = 0; k < 3; ++k) {
      const bool open = at.x(k, 1) > 1e-3;
      EXPECT_EQ(columns[1].values[k] == 0, open) << to_string(r->method) << " " << at.t[k];
    }
  }
  // Rows between steps do not say what happens on these.
  EXPECT_FALSE(has_contact_report(m, at_times(m.scene, *backend, rows, times)));
  EXPECT_THROW(contact_report(m, at_times(m.scene, *backend, rows, times)), Error);
}

TEST(ContactColumns, InSpaceHaveANumberForEachTangent) {
  Structure s = oscillator(
      0.1, 1, [](double) { return 0.0; }, 1);
  s.M = sparse(Matrix::Identity(2, 2)), s.K = sparse(Matrix::Identity(2, 2)), s.C = {};
  s.f = {};
  s.v0 = Vector{{0.3, 0.4}};
  Contact plane;
  plane.name = "plane";
  plane.tangent = Matrix::Identity(2, 2);
  plane.bound = always(0.2);
  const Mechanism m = make_mechanism(s, {plane});
  const Result r = run(m.scene, marched(200));
  const auto columns = contact_columns(m, contact_report(m, r), r.t, r.x, r.y);
  EXPECT_EQ(contact_column_names(m), (std::vector<std::string>{"plane.lt0", "plane.lt1", "plane.state"}));
  // It slides along (3, 4) / 5, against 0.2.
  EXPECT_NEAR(columns[0].values[5], -0.12, 1e-9);
  EXPECT_NEAR(columns[1].values[5], -0.16, 1e-9);
  EXPECT_EQ(columns[2].values[5], 2);
}

}  // namespace
}  // namespace bromwich
