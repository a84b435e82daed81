// Random structures against located events that share no code with the solver: by method events, by march under a
// tolerance, and in mirrors.

#include "tests/mechanics/contact_flow.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace bromwich {
namespace {

using oracle::contact_flow;
using oracle::ContactFlow;

constexpr Index samples = 8;

// Largest error of q at the sampled times, relative to the largest q.
double error_of(const Result& r, const ContactFlow& exact) {
  double size = 1e-3, error = 0;
  for (const Vector& q : exact.q) size = std::max(size, q.cwiseAbs().maxCoeff());
  for (Index k = 1; k <= samples; ++k) {
    const Vector& q = exact.q[std::size_t(k - 1)];
    const Vector x = r.x.row(k * (r.x.rows() - 1) / samples).transpose();
    error = std::max(error, (x.head(q.size()) - q).cwiseAbs().maxCoeff() / size);
  }
  return error;
}

TEST(ContactFlow, IsThatOfTheDigits) {
  constexpr double digits = 1e-9;
  for (const double e : {0.0, 0.5}) {
    const Vector x = e == 0 ? Vector{{-0.2276458679, 0.0644897728, -0.2264338204, -0.5182400725}}
                            : Vector{{-0.2024374329, 0.0637274032, -0.2157451367, -0.5111438908}};
    const ContactFlow flow = contact_flow(make_mechanism(block(1.3, 10), {belt(e)}), 1);
    ASSERT_TRUE(flow.decided) << flow.reason;
    EXPECT_LE((flow.q[0] - x.head(2)).cwiseAbs().maxCoeff(), digits);
    EXPECT_LE((flow.v[0] - x.tail(2)).cwiseAbs().maxCoeff(), digits);
  }
  const ContactFlow aslant = contact_flow(oblique_impact(), 1);
  ASSERT_TRUE(aslant.decided) << aslant.reason;
  EXPECT_LE((aslant.q[0] - Vector{{-0.3086956522, 0}}).cwiseAbs().maxCoeff(), digits);
  EXPECT_LE((aslant.v[0] - Vector{{-0.1739130435, 0}}).cwiseAbs().maxCoeff(), digits);
}

DrawnStructure drawn_structure(std::uint32_t seed) {
  return random_structure(seed, 1 + Index(seed % 5), 2, true, {0, 0.1, 0.3, 0.6, 1, 1.5});
}

Result solved(const DrawnStructure& drawn, Method method, double tolerance) {
  Options options = options_for(method);
  options.states = StateSelection::all;
  options.tolerance = tolerance;
  return run(make_mechanism(drawn.structure, drawn.contacts).scene, options);
}

class ContactFlows : public testing::TestWithParam<int> {};

// The steps of the flow have errors of 1e-9, which impacts enlarge.
TEST_P(ContactFlows, AreThoseOfTheMethods) {
  constexpr double tolerance = 1e-3, of_flow = 1e-6;
  for (std::uint32_t seed = 8 * std::uint32_t(GetParam()); seed < 8 * std::uint32_t(GetParam() + 1); ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    const DrawnStructure drawn = drawn_structure(seed);
    const ContactFlow exact = contact_flow(make_mechanism(drawn.structure, drawn.contacts), samples, 2e-3);
    if (!exact.decided) continue;
    const Result events = solved(drawn, Method::events, 0), march = solved(drawn, Method::march, tolerance);
    EXPECT_EQ(march.status, Status::solved) << march.reason;
    EXPECT_LE(error_of(march, exact), tolerance);
    EXPECT_LE(march.steps, 12800);
    EXPECT_EQ(events.status, Status::solved) << events.reason;
    EXPECT_LE(error_of(events, exact), of_flow);
    const Vector signs = drawn_signs(seed, drawn.structure.M.rows());
    const Result image = solved(mirrored(drawn, signs), Method::march, tolerance);
    ASSERT_EQ(image.status, march.status) << image.reason;
    ContactFlow mirror = exact;  // the steps may be others: y is, of which friction is a part
    for (Vector& q : mirror.q) q = signs.cwiseProduct(q);
    EXPECT_LE(error_of(image, mirror), tolerance);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, ContactFlows, testing::Range(0, 5));

}  // namespace
}  // namespace bromwich
