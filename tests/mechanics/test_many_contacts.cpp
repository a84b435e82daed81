// Several contacts at once by located events: against time stepping that shares no code, with the balance of energy,
// and in mirrors. Chains of blocks on belts, and random structures.

#include "tests/mechanics/mechanisms.hpp"
#include "tests/mechanics/moreau_jean.hpp"

#include <gtest/gtest.h>

#include <utility>

namespace bromwich {
namespace {

using oracle::moreau_jean;

// Located events against two solutions of time stepping: their difference is about the error of the finer one, of order
// one. An impact in another step changes it by a few steps times the velocity, which is below 5. Where impacts magnify
// such changes the steps are too long for that, and shorter ones follow.
void expect_motion(const Mechanism& m) {
  constexpr double velocity = 5, shortest = 2e-4;
  const double T = m.structure.T;
  const Result r = located(m.scene);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const Index d = m.coordinates();
  Vector fine = moreau_jean(m, T, 2e-3).q;
  for (double step = 1e-3;; step /= 2) {
    const Vector coarse = std::exchange(fine, moreau_jean(m, T, step).q);
    const double error = (fine - coarse).cwiseAbs().maxCoeff(),
                 off = (last_state(r).head(d) - fine).cwiseAbs().maxCoeff();
    if (off > 4 * error + velocity * step && step > shortest) continue;
    EXPECT_LE(off, 4 * error + velocity * step);
    break;
  }
  const ContactReport report = contact_report(m, r);
  EXPECT_TRUE(report.located);
  EXPECT_LE(report.energy.error, 1e-9);
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {  // no force pulls, no friction is above mu ln, no gap is closed
    const Vector ln = m.normal_forces(r.y).col(Index(i));
    EXPECT_GE(ln.minCoeff(), -1e-9);
    if (m.contacts[i].kn == 0) {
      const Vector gap = (r.x.leftCols(d) * m.contacts[i].normal).array() + [&] {
        Vector g = Vector::Zero(1);
        if (m.contacts[i].gap) m.contacts[i].gap(0, g);
        return g[0];
      }();
      EXPECT_GE(gap.minCoeff(), -1e-9) << m.contacts[i].name;
    }
  }
}

// Blocks with springs between them, each on a belt of its own; the loads come one after the other.
Mechanism chain(Index blocks, double restitution) {
  const Index d = 2 * blocks;
  Matrix K = Matrix::Zero(d, d);
  std::vector<Contact> contacts;
  for (Index i = 0; i < blocks; ++i) {
    const Index x = 2 * i, z = x + 1;
    K(x, x) += 2, K(z, z) += 1.5, K(x, z) -= 0.6, K(z, x) -= 0.6;
    if (i + 1 < blocks) K(x, x) += 1, K(x + 2, x + 2) += 1, K(x, x + 2) -= 1, K(x + 2, x) -= 1;
    Contact c = belt(restitution);
    c.normal = Vector::Unit(d, z);
    c.tangent = Vector::Unit(d, x).transpose();
    contacts.push_back(c);
  }
  Structure s;
  s.M = sparse(Matrix::Identity(d, d)), s.K = sparse(K);
  s.C = sparse(Matrix(0.04 * Matrix::Identity(d, d) + 0.01 * K));
  s.f = forces([d](double t) {
    Vector f(d);
    for (Index i = 0; i < d / 2; ++i) {
      f[2 * i] = 0.3 * std::sin(2.1 * t + double(i));
      f[2 * i + 1] = -1 + 1.3 * std::cos(2.1 * t + 0.7 * double(i));
    }
    return f;
  });
  s.T = 4;
  s.breakpoints_are_all = true;
  return make_mechanism(s, contacts);
}

TEST(ManyContacts, ChainsOfBlocks) {
  for (const Index blocks : {2, 4, 8, 16})
    for (const double e : {0.0, 0.5}) {
      SCOPED_TRACE(testing::Message() << blocks << " blocks, e = " << e);
      expect_motion(chain(blocks, e));
    }
}

DrawnStructure drawn_structure(std::uint32_t seed, Index contacts) {
  return random_structure(seed, contacts, 3, true, {0, 0.1, 0.3, 0.6, 1, 1.5});
}

class RandomStructure : public testing::TestWithParam<int> {};

TEST_P(RandomStructure, MovesAsTimeSteppingSays) {
  for (std::uint32_t seed = 8 * std::uint32_t(GetParam()); seed < 8 * std::uint32_t(GetParam() + 1); ++seed) {
    SCOPED_TRACE(testing::Message() << "seed " << seed);
    const DrawnStructure drawn = drawn_structure(seed, 1 + Index(seed % 16));
    expect_motion(make_mechanism(drawn.structure, drawn.contacts));
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, RandomStructure, testing::Range(0, 6));

// Tangents and velocities of the other bodies with other signs: the same motion.
TEST(ManyContacts, TurnedTangentsChangeNothing) {
  for (const std::uint32_t seed : {2u, 3u, 8u, 13u}) {
    DrawnStructure drawn = drawn_structure(seed, 1 + Index(seed % 5));
    const Vector x = last_state(located(make_mechanism(drawn.structure, drawn.contacts).scene));
    for (Contact& c : drawn.contacts) {
      c.tangent = -c.tangent;
      if (c.velocity)
        c.velocity = forces([V = c.velocity](double t) {
          Vector value(1);
          V(t, value);
          return Vector(-value);
        });
    }
    const Vector y = last_state(located(make_mechanism(drawn.structure, drawn.contacts).scene));
    EXPECT_LE((x - y).cwiseAbs().maxCoeff(), 1e-7) << seed;  // impacts enlarge differences of 1e-10
  }
}

}  // namespace
}  // namespace bromwich
