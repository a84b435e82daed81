#include "mechanics/contact_input.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"

#include <Eigen/SparseCholesky>

#include <cmath>
#include <set>

namespace bromwich {

namespace {

std::string shape(Index rows, Index cols) { return text("is %td x %td", rows, cols); }

bool finite(const SparseMatrix& m) {
  for (Index k = 0; k < m.outerSize(); ++k)
    for (SparseMatrix::InnerIterator e(m, k); e; ++e)
      if (!std::isfinite(e.value())) return false;
  return true;
}

void check_matrix(const char* name, const SparseMatrix& m, Index d) {
  if (m.rows() == 0 && m.cols() == 0) return;
  if (m.rows() != d || m.cols() != d)
    throw Error(name, shape(m.rows(), m.cols()), text("make it %td x %td, as M is", d, d));
  if (!finite(m)) throw Error(name, "has an entry that is not finite", "give finite numbers");
}

// Of the matrix in units in which its diagonal is 1.
bool positive_definite(const SparseMatrix& m) {
  const Vector diagonal = m.diagonal();
  if (!(diagonal.array() > 0).all()) return false;
  const Vector by = diagonal.cwiseSqrt().cwiseInverse();
  const SparseMatrix scaled = by.asDiagonal() * m * by.asDiagonal(), transposed = scaled.transpose();
  constexpr double rounding = 1e-12;
  if ((scaled - transposed).norm() > rounding * scaled.norm()) return false;
  const Eigen::SimplicialLDLT<SparseMatrix> ldlt(scaled);
  return ldlt.info() == Eigen::Success && (ldlt.vectorD().array() > 0).all();
}

class ContactCheck {
 public:
  ContactCheck(const Contact& contact, Index i, Index d) : c_(contact), i_(i), d_(d) {}

  void run() const {
    check_rows();
    check_numbers();
    if (c_.normal.size() == 0) check_given_bound();
    check_friction();
  }

 private:
  [[noreturn]] void fail(const char* member, const std::string& found, const std::string& remedy) const {
    throw Error(text("contacts[%td].%s", i_, member), found, remedy);
  }

  void check_rows() const {
    if (c_.normal.size() != 0 && c_.normal.size() != d_)
      fail("normal", text("has %td entries", c_.normal.size()), text("give one for each of the %td coordinates", d_));
    if (!c_.normal.allFinite()) fail("normal", "has an entry that is not finite", "give finite numbers");
    if (c_.normal.size() > 0 && c_.normal.isZero(0)) fail("normal", "is zero", "give the row Hn of the gap Hn q + g");
    if (c_.tangent.rows() > 2)
      fail("tangent", text("has %td rows", c_.tangent.rows()), "give one row, or two in space");
    if (c_.tangent.rows() > 0 && c_.tangent.cols() != d_)
      fail("tangent", text("has %td entries", c_.tangent.cols()), text("give one for each of the %td coordinates", d_));
    if (!c_.tangent.allFinite()) fail("tangent", "has an entry that is not finite", "give finite numbers");
    for (Index k = 0; k < c_.tangent.rows(); ++k)
      if (c_.tangent.row(k).isZero(0)) fail("tangent", "is zero", "give the row Ht of the sliding velocity Ht q' - V");
  }

  void check_numbers() const {
    if (!(c_.mu >= 0 && std::isfinite(c_.mu))) fail("mu", text("is %g", c_.mu), "give a number >= 0");
    if (!(c_.restitution >= 0 && c_.restitution <= 1))
      fail("restitution", text("is %g", c_.restitution), "give a number from 0 to 1");
    for (const auto& [name, k] : {std::pair("kn", c_.kn), {"kt", c_.kt}})
      if (!(k >= 0 && std::isfinite(k)))
        fail(name, text("is %g", k), "give a positive stiffness, or 0 for a rigid contact");
    if (c_.kn > 0 && c_.restitution > 0)
      fail("restitution", text("is %g beside kn", c_.restitution),
           "leave it out: a compliant contact has no impacts; or leave kn out");
  }

  void check_given_bound() const {
    if (!c_.bound) fail("normal", "is missing", "give the row Hn, or bound: the friction R(t) of a given normal force");
    if (c_.gap) fail("gap", "is given without normal", "leave it out, or give normal and mu in place of bound");
    for (const auto& [name, value] : {std::pair("mu", c_.mu), {"restitution", c_.restitution}, {"kn", c_.kn}})
      if (value != 0)
        fail(name, "is given with bound and without normal", "leave it out: bound is the whole friction, mu ln");
    if (c_.tangent.rows() == 0) fail("tangent", "is missing beside bound", "give the row Ht of the sliding velocity");
  }

  void check_friction() const {
    if (c_.normal.size() > 0 && c_.bound)
      fail("bound", "is given beside normal", "give mu for friction of the normal force, or a contact of its own");
    const Index tangents = c_.tangent.rows();
    if (tangents == 0) {
      if (c_.mu > 0) fail("tangent", "is missing beside mu", "give the row Ht of the sliding velocity");
      if (c_.velocity) fail("velocity", "is given without tangent", "add tangent, or leave it out");
      if (c_.kt > 0) fail("kt", "is given without tangent", "add tangent, or leave it out");
    }
    if (c_.facets != 0 && tangents != 2)
      fail("facets", text("is %td with %td tangents", c_.facets, tangents), "give two tangents, or leave it out");
    if (tangents == 2 && c_.facets != 0 && (c_.facets < 4 || c_.facets % 2 != 0 || c_.facets > 128))
      fail("facets", text("is %td", c_.facets),
           "give an even number from 4 to 128: the circle of friction forces becomes a polygon; or leave it out");
    if (tangents == 2 && c_.facets == 0 && c_.kn > 0)
      fail("facets", "is missing beside kn and two tangents",
           "give it: friction on a circle is that of rigid contacts");
    if (tangents == 2 && c_.kt > 0) fail("kt", "is given with two tangents", "give one: Jenkins elements are planar");
  }

  const Contact& c_;
  Index i_, d_;
};

void check_names(const Structure& s, const std::vector<Contact>& contacts) {
  std::set<std::string> seen;
  const auto check = [&](const std::string& argument, const std::string& name) {
    if (name.empty() || name.find_first_of(",\"'#=") != std::string::npos)
      throw Error(argument, "found '" + name + "'",
                  "give names without commas, quotes, # and =: they are headers of columns");
    if (!seen.insert(name).second) throw Error(argument, "'" + name + "' is taken", "give each a name of its own");
  };
  for (const std::string& name : s.names) {
    check("names", name);
    check("names", "v_" + name);
  }
  for (std::size_t i = 0; i < contacts.size(); ++i) check(text("contacts[%zu].name", i), contacts[i].name);
}

}  // namespace

void check_structure(const Structure& s) {
  const Index d = s.M.rows();
  if (d == 0) throw Error("M", "is empty", "give the mass matrix, coordinates x coordinates");
  if (s.M.cols() != d) throw Error("M", shape(d, s.M.cols()), "make it square, coordinates x coordinates");
  if (!finite(s.M)) throw Error("M", "has an entry that is not finite", "give finite numbers");
  if (!positive_definite(s.M))
    throw Error("M", "is not symmetric and positive definite", "give the mass matrix of all coordinates");
  check_matrix("C", s.C, d);
  check_matrix("K", s.K, d);
  for (const auto& [name, value] : {std::pair("q0", &s.q0), {"v0", &s.v0}}) {
    if (value->size() != 0 && value->size() != d)
      throw Error(name, text("has %td entries", value->size()), text("give one for each of the %td coordinates", d));
    if (value->size() != 0 && s.periodic)
      throw Error(name, "is given with a periodic state", "leave it out: the state is looked for");
    if (!value->allFinite()) throw Error(name, "has an entry that is not finite", "give finite numbers");
  }
  if (!s.names.empty() && Index(s.names.size()) != d)
    throw Error("names", text("has %zu entries", s.names.size()), text("give one for each of the %td coordinates", d));
  if (!(s.T > 0 && std::isfinite(s.T))) throw Error("T", text("is %g", s.T), "give a positive finite number");
}

void check_contacts(const Structure& s, const std::vector<Contact>& contacts) {
  for (std::size_t i = 0; i < contacts.size(); ++i) ContactCheck(contacts[i], Index(i), s.M.rows()).run();
  check_names(s, contacts);
}

}  // namespace bromwich
