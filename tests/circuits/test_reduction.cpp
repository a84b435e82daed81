// What the reduction has found and says: loops, cutsets, windings, and what is kept where a start is inconsistent.

#include "core/solve/dense_output.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

using test::circuit_of;
using Words = std::vector<std::string>;

/// An output of a circuit without diodes at t = 0.
double at_start(const Circuit& c, const std::string& name) {
  Result r;
  r.t = Vector::Zero(1);
  r.x = c.scene.x0.transpose();
  r.y = RowMatrix::Zero(1, 1);
  const RowMatrix values = output_values(c, r);
  for (std::size_t i = 0; i < c.outputs.size(); ++i)
    if (c.outputs[i].name == name) return values(0, Index(i));
  return NAN;
}

TEST(Reduction, NamesStatesPairsAndOpenElements) {
  const Circuit c = circuit_of(
      "V1 in 0 1\nVg g 0 PULSE(0 1 0 1n 1n 1u 2u)\nS1 in a g 0 SI\nD1 0 a DI\nD2 0 a DK\nL1 a b 1m\nC1 b 0 1u\n"
      "R1 b 0 1\n.model SI SW(Ron=1m Roff=1Meg Vt=.5)\n.model DI D(Ron=1m)\n.model DK D(Ron=1m Roff=1k)\n"
      ".tran 1u uic\n");
  EXPECT_EQ(c.reduction.states, (Words{"I(L1)", "V(C1)"}));
  EXPECT_EQ(c.reduction.pairs, (Words{"S1.p", "S1.q", "D1", "D2"}));
  EXPECT_EQ(c.reduction.open, (Words{"D1"}));
  EXPECT_EQ(c.reduction.summary, "8 elements, 4 nodes: 2 states, 4 pairs, 2 sources");
}

TEST(Reduction, LoopsCutsetsAndWindingsAreEquations) {
  const Circuit c = circuit_of(
      "V1 a 0 PWL(0 0 1m 10)\nC1 a b 1u\nC2 b 0 3u\nR2 b 0 1k\nI1 0 c PWL(0 0 1m 1)\nL1 c d 1m\nL2 d 0 2m\n"
      "R3 d 0 1\nR4 c 0 1\nL3 b 0 1m\nL4 f 0 9m\nK1 L3 L4 1\nL5 f h 1m\nL6 h 0 1m\n.tran 1m uic\n");
  EXPECT_EQ(c.reduction.loops, (Words{"V(C2) = -V(C1) + V1"}));
  EXPECT_EQ(c.reduction.windings, (Words{"V(L4) = 3 V(L3)"}));
  ASSERT_EQ(c.reduction.cutsets.size(), 1u);
  EXPECT_TRUE(c.reduction.cutsets[0] == "I(L6) = I(L5)" || c.reduction.cutsets[0] == "I(L5) = I(L6)")
      << c.reduction.cutsets[0];
}

// Charge: (C1 + C2) v = C1 10.
TEST(Reduction, CapacitorsShareTheirCharge) {
  const Circuit c = circuit_of("C1 a 0 1u IC=10\nC2 a 0 3u\nR1 a 0 1k\n.tran 1m uic\n");
  EXPECT_NEAR(c.scene.x0[0], 2.5, 1e-12);
  ASSERT_EQ(c.notes.size(), 2u);
  EXPECT_EQ(c.notes[0], "V(C1) jumps from 10 to 2.5 at t = 0: it is in a loop of capacitors and voltage sources");
  EXPECT_TRUE(circuit_of("C1 a 0 1u IC=10\nC2 a 0 3u IC=10\nR1 a 0 1k\n.tran 1m uic\n").notes.empty());
  // A source of 12 V in series with C1 and C2, both empty: b is at C1 / (C1 + C2) of it.
  const Circuit divider = circuit_of("V1 a 0 12\nC1 a b 1u\nC2 b 0 3u\nR1 b 0 1k\n.tran 1m uic\n");
  EXPECT_NEAR(at_start(divider, "V(b)"), 3, 1e-12);
}

// Resistances alone have a state that stays 0: a half wave into 10 ohm.
TEST(Reduction, CircuitsWithoutStorage) {
  const Circuit c = circuit_of("V1 a 0 SIN(0 10 50)\nD1 a b DI\nR1 b 0 10\n.model DI D(Ron=1)\n.tran 1m 20m\n");
  EXPECT_EQ(c.scene.states(), 1);
  Options options;
  options.states = StateSelection::all;
  options.tolerance_x = 1e-4;
  const auto backend = make_cpu_backend(1);
  const Result r = solve(c.scene, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const RowMatrix v = output_values(c, at_times(c.scene, *backend, r, {5e-3, 15e-3}));
  for (std::size_t i = 0; i < c.outputs.size(); ++i)
    if (c.outputs[i].name == "I(R1)") {
      EXPECT_NEAR(v(0, Index(i)), 10.0 / 11, 1e-12);
      EXPECT_NEAR(v(1, Index(i)), 0, 1e-12);
    }
}

// A ladder of R and C: the rows of A have -1, 1 or -2, 1, whatever its length, and no other entries.
TEST(Reduction, LaddersStaySparse) {
  std::string cards = "V1 n0 0 1\n";
  constexpr int n = 3000;
  for (int k = 0; k < n; ++k) {
    const std::string a = std::to_string(k), b = std::to_string(k + 1);
    cards += "R" + b + " n" + a + " n" + b + " 2\nC" + b + " n" + b + " 0 0.5\n";
  }
  const Circuit c = circuit_of(cards + ".tran 1 uic\n");
  ASSERT_EQ(c.scene.states(), n);
  const auto matrices = c.scene.dynamics->matrices();
  ASSERT_TRUE(matrices);
  const SparseMatrix& A = matrices->A;
  EXPECT_EQ(A.nonZeros(), 3 * n - 2);
  for (int k = 0; k < n; ++k) {
    EXPECT_NEAR(A.coeff(k, k), k + 1 < n ? -2 : -1, 1e-12);
    if (k > 0) EXPECT_NEAR(A.coeff(k, k - 1), 1, 1e-12);
  }
}

// Flux around L1, L2, L5: 2 mH 3 A = (1 mH + 2 mH) i - 1 mH (1 A - i).
TEST(Reduction, InductorsShareTheirFlux) {
  const Circuit c = circuit_of("I1 0 c 1\nL1 c d 1m\nL2 d 0 2m IC=3\nL5 c e 1m\nR5 e 0 1\n.tran 1m uic\n");
  ASSERT_EQ(c.reduction.states, (Words{"I(L5)"}));
  EXPECT_NEAR(at_start(c, "I(L2)"), 1.75, 1e-12);
}

}  // namespace
}  // namespace bromwich
