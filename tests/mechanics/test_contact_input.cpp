// Structures and contacts with mistakes: one line names the member, what was found, and the remedy.

#include "tests/mechanics/mechanisms.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

struct Mistake {
  std::function<void(Structure&, Contact&)> make;
  std::string message;
};

TEST(ContactInput, MistakesAreNamed) {
  const std::vector<Mistake> mistakes{
      {[](Structure& s, Contact&) { s.M = SparseMatrix(); }, "M: is empty; give the mass matrix"},
      {[](Structure& s, Contact&) { s.M = sparse(Matrix::Zero(2, 3)); }, "M: is 2 x 3; make it square"},
      {[](Structure& s, Contact&) {
         s.M = sparse(Matrix{{1, 2}, {2, 1}});
       },
       "M: is not symmetric and positive definite"},
      {[](Structure& s, Contact&) {
         s.M = sparse(Matrix{{1, 0.1}, {0, 1}});
       },
       "M: is not symmetric and positive definite"},
      {[](Structure& s, Contact&) { s.C = sparse(Matrix::Zero(1, 1)); }, "C: is 1 x 1; make it 2 x 2"},
      {[](Structure& s, Contact&) {
         s.K = sparse(Matrix{{NAN, 0}, {0, 1}});
       },
       "K: has an entry that is not finite"},
      {[](Structure& s, Contact&) { s.q0 = Vector{{1}}; }, "q0: has 1 entries; give one for each of the 2 coordinates"},
      {[](Structure& s, Contact&) {
         s.v0 = Vector{{1, INFINITY}};
       },
       "v0: has an entry that is not finite"},
      {[](Structure& s, Contact&) {
         s.periodic = true, s.v0 = Vector{{1, 0}};
       },
       "v0: is given with a periodic state"},
      {[](Structure& s, Contact&) { s.names = {"a"}; }, "names: has 1 entries"},
      {[](Structure& s, Contact&) {
         s.names = {"a", "a"};
       },
       "names: 'a' is taken"},
      {[](Structure& s, Contact&) {
         s.names = {"a", "v_a"};
       },
       "names: 'v_a' is taken"},
      {[](Structure& s, Contact&) { s.T = 0; }, "T: is 0; give a positive finite number"},
      {[](Structure&, Contact& c) { c.normal = Vector{{1}}; }, "contacts[0].normal: has 1 entries"},
      {[](Structure&, Contact& c) { c.normal.setZero(); }, "contacts[0].normal: is zero"},
      {[](Structure&, Contact& c) { c.normal = Vector(), c.mu = 0, c.restitution = 0; },
       "contacts[0].normal: is missing; give"},
      {[](Structure&, Contact& c) { c.tangent = Matrix::Ones(3, 2); }, "contacts[0].tangent: has 3 rows"},
      {[](Structure&, Contact& c) { c.tangent = Matrix{{1}}; }, "contacts[0].tangent: has 1 entries"},
      {[](Structure&, Contact& c) { c.tangent.setZero(); }, "contacts[0].tangent: is zero"},
      {[](Structure&, Contact& c) { c.tangent = Matrix(), c.velocity = {}; },
       "contacts[0].tangent: is missing beside mu"},
      {[](Structure&, Contact& c) { c.tangent = Matrix(), c.mu = 0; },
       "contacts[0].velocity: is given without tangent"},
      {[](Structure&, Contact& c) { c.mu = -0.1; }, "contacts[0].mu: is -0.1; give a number >= 0"},
      {[](Structure&, Contact& c) { c.restitution = 1.1; },
       "contacts[0].restitution: is 1.1; give a number from 0 to 1"},
      {[](Structure&, Contact& c) { c.restitution = 0.5, c.kn = 10; }, "contacts[0].restitution: is 0.5 beside kn"},
      {[](Structure&, Contact& c) { c.kn = -1; }, "contacts[0].kn: is -1; give a positive stiffness"},
      {[](Structure&, Contact& c) { c.bound = always(1); }, "contacts[0].bound: is given beside normal"},
      {[](Structure&, Contact& c) { c.normal = Vector(), c.bound = always(1); }, "contacts[0].mu: is given with bound"},
      {[](Structure&, Contact& c) { c.facets = 8; }, "contacts[0].facets: is 8 with 1 tangents"},
      {[](Structure&, Contact& c) { c.tangent = Matrix::Identity(2, 2), c.velocity = {}, c.facets = 5; },
       "contacts[0].facets: is 5"},
      {[](Structure&, Contact& c) { c.tangent = Matrix::Identity(2, 2), c.velocity = {}, c.kn = 3, c.restitution = 0; },
       "contacts[0].facets: is missing beside kn"},
      {[](Structure&, Contact& c) { c.tangent = Matrix::Identity(2, 2), c.velocity = {}, c.facets = 8, c.kt = 1; },
       "contacts[0].kt: is given with two tangents"},
      {[](Structure&, Contact& c) { c.name = "a,b"; }, "contacts[0].name: found 'a,b'"},
  };
  for (const Mistake& mistake : mistakes) {
    Structure s = block(0.6, 1);
    Contact c = belt();
    mistake.make(s, c);
    const std::string found = refusal([&] { make_mechanism(s, {c}); });
    EXPECT_TRUE(found.starts_with(mistake.message)) << found << "\nexpected " << mistake.message;
    EXPECT_EQ(found.find('\n'), std::string::npos);
  }
}

TEST(ContactInput, NamesOfContactsDiffer) {
  Contact a = belt(), b = belt();
  a.name = b.name = "jaw";
  EXPECT_TRUE(refusal([&] { make_mechanism(block(0.6, 1), {a, b}); }).starts_with("contacts[1].name: 'jaw' is taken"));
  b.name = "";
  const Mechanism m = make_mechanism(block(0.6, 1), {a, b});
  EXPECT_EQ(m.scene.names.y, (std::vector<std::string>{"jaw.normal", "jaw.friction", "jaw.slip", "c1.normal",
                                                       "c1.friction", "c1.slip"}));
  EXPECT_EQ(m.scene.names.x, (std::vector<std::string>{"q0", "q1", "v_q0", "v_q1"}));
}

}  // namespace
}  // namespace bromwich
