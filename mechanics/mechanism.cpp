#include "mechanics/mechanism.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/scene/relay.hpp"
#include "mechanics/contact_input.hpp"
#include "mechanics/contact_kinds.hpp"
#include "mechanics/contact_sources.hpp"
#include "mechanics/source_values.hpp"

#include <Eigen/Cholesky>

#include <array>
#include <memory>

namespace bromwich {

namespace {

constexpr Index most_dense = 200;  ///< states, and rows of M

using Entries = std::vector<Eigen::Triplet<double>>;

/// Rows of y and w that the friction of a contact takes.
Index friction_rows(const Contact& c) {
  if (!has_friction(c)) return 0;
  if (is_circle(c)) return c.normal.size() > 0 ? 2 : 3;
  return c.facets > 0 ? c.facets + 1 : 2;
}

/// B, N and M of a scene, with B as forces: its rows are those of M q''.
class Rows {
 public:
  Rows(const std::vector<Contact>& contacts, Index d) : d_(d), states_(2 * d) {
    for (const Contact& c : contacts) {
      ContactRows r;
      if (c.normal.size() > 0) r.normal = n_++;
      if (has_friction(c)) r.friction = n_;
      n_ += friction_rows(c);
      if (has_friction(c) && is_Jenkins(c)) r.state = states_++;
      rows_.push_back(r);
    }
    for (std::size_t i = 0; i < contacts.size(); ++i) add(contacts[i], rows_[i]);
  }

  const std::vector<ContactRows>& rows() const { return rows_; }
  Index states() const { return states_; }
  Index constraints() const { return n_; }
  Entries forces;     ///< d x n: what y does to M q''
  Entries of_states;  ///< states x n: what it does to the forces of Jenkins elements
  Entries N, M;
  Entries springs;  ///< states x states: the force and the rate of Jenkins elements; rows of q' as forces

 private:
  void put(Entries& into, Index row, const Vector& values, Index first) const {
    for (Index j = 0; j < values.size(); ++j)
      if (values[j] != 0) into.emplace_back(row, first + j, values[j]);
  }
  void put_column(Entries& into, Index column, const Vector& values) const {
    for (Index j = 0; j < values.size(); ++j)
      if (values[j] != 0) into.emplace_back(j, column, values[j]);
  }

  void add(const Contact& c, const ContactRows& r) {
    if (r.normal >= 0) {
      put(N, r.normal, c.normal, 0);
      put_column(forces, r.normal, c.normal);
      if (c.kn > 0) M.emplace_back(r.normal, r.normal, 1 / c.kn);
    }
    if (r.friction < 0) return;
    if (r.state >= 0)
      add_Jenkins(c, r);
    else if (c.facets > 0)
      add_facets(c, r);
    else if (is_circle(c))
      add_circle(c, r);
    else
      add_planar(c, r);
  }

  void add_circle(const Contact& c, const ContactRows& r) {
    for (Index k = 0; k < 2; ++k) {
      put(N, circle_row(r) + k, c.tangent.row(k).transpose(), d_);
      put_column(forces, circle_row(r) + k, c.tangent.row(k).transpose());
    }
    if (r.normal < 0) M.emplace_back(r.friction, r.friction, 1);
  }

  // lt = b - mu ln, or b - R.
  void add_planar(const Contact& c, const ContactRows& r) {
    const Index b = r.friction, slip = b + 1;
    const Vector Ht = c.tangent.row(0).transpose();
    put(N, b, Ht, d_);
    put_column(forces, b, Ht);
    M.emplace_back(b, slip, 1);
    M.emplace_back(slip, b, -1);
    if (r.normal < 0) return;
    put_column(forces, r.normal, Vector(-c.mu * Ht));
    M.emplace_back(slip, r.normal, 2 * c.mu);
  }

  // x[state] = -lt.
  void add_Jenkins(const Contact& c, const ContactRows& r) {
    const Index plus = r.friction, minus = plus + 1;
    const Vector Ht = c.tangent.row(0).transpose();
    put(springs, r.state, Vector(c.kt * Ht), d_);
    for (Index j = 0; j < d_; ++j)
      if (Ht[j] != 0) springs.emplace_back(d_ + j, r.state, -Ht[j]);
    of_states.emplace_back(r.state, plus, -c.kt);
    of_states.emplace_back(r.state, minus, c.kt);
    N.emplace_back(plus, r.state, -1);
    N.emplace_back(minus, r.state, 1);
    if (r.normal < 0) return;
    M.emplace_back(plus, r.normal, c.mu);
    M.emplace_back(minus, r.normal, c.mu);
  }

  void add_facets(const Contact& c, const ContactRows& r) {
    const Index last = r.friction + c.facets;
    const Matrix along = directions(c.facets) * c.tangent;
    for (Index k = 0; k < c.facets; ++k) {
      put(N, r.friction + k, along.row(k).transpose(), d_);
      put_column(forces, r.friction + k, along.row(k).transpose());
      M.emplace_back(r.friction + k, last, 1);
      M.emplace_back(last, r.friction + k, -1);
    }
    if (r.normal >= 0) M.emplace_back(last, r.normal, c.mu);
  }

  Index d_, states_, n_ = 0;
  std::vector<ContactRows> rows_;
};

SparseMatrix sparse(Index rows, Index cols, const Entries& entries) {
  SparseMatrix m(rows, cols);
  m.setFromTriplets(entries.begin(), entries.end());
  return m;
}

void add_block(Entries& into, const SparseMatrix& m, Index row, Index col, double factor) {
  for (Index k = 0; k < m.outerSize(); ++k)
    for (SparseMatrix::InnerIterator e(m, k); e; ++e)
      into.emplace_back(row + e.row(), col + e.col(), factor * e.value());
}

/// x' of states, with the rows of q' as forces.
struct Forced {
  SparseMatrix A, B, N, M;
};

Forced forced_system(const Structure& s, const Rows& rows) {
  const Index d = s.M.rows(), m = rows.states(), n = rows.constraints();
  Entries A = rows.springs;
  for (Index i = 0; i < d; ++i) A.emplace_back(i, d + i, 1);
  add_block(A, s.K, d, 0, -1);
  add_block(A, s.C, d, d, -1);
  Entries B = rows.of_states;
  add_block(B, sparse(d, n, rows.forces), d, 0, 1);
  return {sparse(m, m, A), sparse(m, n, B), sparse(n, m, rows.N), sparse(n, n, rows.M)};
}

void set_matrices(const Forced& system, const Structure& s, const std::shared_ptr<const Eigen::LLT<Matrix>>& mass,
                  Scene& scene) {
  const Index d = s.M.rows(), n = system.M.rows();
  if (mass) {
    Matrix A = system.A, B = system.B;
    A.middleRows(d, d) = mass->solve(A.middleRows(d, d).eval());
    B.middleRows(d, d) = mass->solve(B.middleRows(d, d).eval());
    scene.dynamics = DenseDynamics{A, B, Matrix(system.N)};
  } else {
    Entries E;
    for (Index i = 0; i < system.A.rows(); ++i)
      if (i < d || i >= 2 * d) E.emplace_back(i, i, 1);
    add_block(E, s.M, d, d, 1);
    scene.dynamics = SparseDynamics{system.A, system.B, system.N, sparse(system.A.rows(), system.A.rows(), E)};
  }
  if (n <= most_dense)
    scene.M = Matrix(system.M);
  else
    scene.M = SparseLcpMatrix(system.M);
}

void set_names(const Mechanism& m, Scene& scene) {
  const Structure& s = m.structure;
  for (const char* prefix : {"", "v_"})
    for (const std::string& name : s.names) scene.names.x.push_back(prefix + name);
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    const Contact& c = m.contacts[i];
    const ContactRows& r = m.rows[i];
    std::vector<std::string>&y = scene.names.y, &w = scene.names.w;
    const auto add = [&](const std::string& of_y, const std::string& of_w) {
      y.push_back(c.name + "." + of_y);
      w.push_back(c.name + "." + of_w);
    };
    if (r.state >= 0) scene.names.x.push_back(c.name + ".spring");
    if (r.normal >= 0) add("normal", "gap");
    if (r.friction < 0) continue;
    if (r.state >= 0) {
      add("slip+", "room+");
      add("slip-", "room-");
    } else if (c.facets > 0) {
      for (Index k = 0; k < c.facets; ++k) add(text("facet%td", k), text("slide%td", k));
      add("slip", "room");
    } else if (is_circle(c)) {
      if (r.normal < 0) add("bound", "off");
      for (const char* k : {"0", "1"}) add(std::string("friction") + k, std::string("slide") + k);
    } else {
      add("friction", "slide");
      add("slip", "room");
    }
  }
}

// Of scenes with rigid contacts, though all may be 0.
Vector restitutions(const Mechanism& m, Index n) {
  Vector e = Vector::Zero(n);
  bool rigid = false;
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    if (m.rows[i].normal < 0) continue;
    e[m.rows[i].normal] = m.contacts[i].restitution;
    rigid = rigid || m.contacts[i].kn == 0;
  }
  return rigid ? e : Vector();
}

std::vector<FrictionCone> circles(const Mechanism& m) {
  std::vector<FrictionCone> cones;
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    if (!is_circle(m.contacts[i])) continue;
    const bool given = m.rows[i].normal < 0;
    cones.push_back({circle_row(m.rows[i]) - 1, given ? 1 : m.contacts[i].mu, given});
  }
  return cones;
}

void set_conditions(const Structure& s, Index states, Scene& scene) {
  if (s.periodic) {
    const Matrix I = Matrix::Identity(states, states);
    scene.boundary = BoundaryCondition{I, -I, Vector::Zero(states)};
    return;
  }
  const Index d = s.M.rows();
  scene.x0 = Vector::Zero(states);
  if (s.q0.size() > 0) scene.x0.head(d) = s.q0;
  if (s.v0.size() > 0) scene.x0.segment(d, d) = s.v0;
}

// Their rows before all others.
void add_relays(const Relays& relays, const std::shared_ptr<const Eigen::LLT<Matrix>>& mass, Mechanism& made) {
  Scene& scene = made.scene;
  const Index d = made.coordinates(), m = scene.states(), n = scene.constraints(), k = relays.C.rows();
  if (!mass)
    throw Error("relays", text("found with %td states", m),
                text("give a structure with %td states at most", most_dense));
  Matrix B = Matrix::Zero(m, k), C = Matrix::Zero(k, m);
  B.middleRows(d, d) = mass->solve(relays.B);
  C.leftCols(2 * d) = relays.C;
  const DenseDynamics of_contacts = *scene.dynamics->small_state();
  Scene both = with_pairs(relay_scene(of_contacts.A, B, C, scene.f, scene.x0, relays.e, relays.bound), of_contacts.B,
                          of_contacts.N, std::get<Matrix>(scene.M), scene.g);
  scene.dynamics = both.dynamics;
  scene.M = both.M;
  scene.f = both.f;
  scene.g = both.g;
  scene.relays = k;
  if (scene.restitution.size() > 0) {
    Vector e = Vector::Zero(2 * k + n);
    e.tail(n) = scene.restitution;
    scene.restitution = e;
  }
  for (FrictionCone& cone : scene.cones) cone.first += 2 * k;
  for (ContactRows& r : made.rows)
    for (Index* row : {&r.normal, &r.friction})
      if (*row >= 0) *row += 2 * k;
  for (auto& [list, words] :
       {std::pair(&scene.names.y, std::array{"s", "plus"}), {&scene.names.w, {"minus", "rest"}}}) {
    std::vector<std::string> of_relays;
    for (const char* word : words)
      for (Index i = 0; i < k; ++i) of_relays.push_back(text("relay%td.%s", i, word));
    list->insert(list->begin(), of_relays.begin(), of_relays.end());
  }
}

}  // namespace

Mechanism make_mechanism(Structure structure, std::vector<Contact> contacts, const Relays& relays) {
  check_structure(structure);
  const Index d = structure.M.rows();
  if (structure.names.empty())
    for (Index i = 0; i < d; ++i) structure.names.push_back(text("q%td", i));
  for (std::size_t i = 0; i < contacts.size(); ++i)
    if (contacts[i].name.empty()) contacts[i].name = text("c%zu", i);
  check_contacts(structure, contacts);
  const Rows rows(contacts, d);
  Mechanism made{std::move(structure), std::move(contacts), rows.rows(), relays, {}};
  const Structure& s = made.structure;
  std::shared_ptr<const Eigen::LLT<Matrix>> mass;
  if (rows.states() <= most_dense) mass = std::make_shared<const Eigen::LLT<Matrix>>(Matrix(s.M));
  Scene& scene = made.scene;
  scene.name = s.name;
  scene.T = s.T;
  set_matrices(forced_system(s, rows), s, mass, scene);
  const auto shared = std::make_shared<const std::vector<Contact>>(made.contacts);
  scene.f = source_of_states(s, shared, made.rows, rows.states(), mass);
  scene.g = source_of_rows(shared, made.rows);
  scene.breakpoints = s.breakpoints;
  scene.breakpoints_are_all = s.breakpoints_are_all;
  scene.restitution = restitutions(made, rows.constraints());
  scene.cones = circles(made);
  set_conditions(s, rows.states(), scene);
  set_names(made, scene);
  if (relays.C.rows() > 0) add_relays(relays, mass, made);
  scene.validate();
  return made;
}

RowMatrix Mechanism::normal_forces(const RowMatrix& y) const {
  RowMatrix forces = RowMatrix::Zero(y.rows(), Index(contacts.size()));
  for (std::size_t i = 0; i < contacts.size(); ++i)
    if (rows[i].normal >= 0) forces.col(Index(i)) = y.col(rows[i].normal);
  return forces;
}

RowMatrix Mechanism::friction_forces(const Vector& t, const RowMatrix& x, const RowMatrix& y) const {
  Index tangents = 0;
  for (const Contact& c : contacts) tangents += c.tangent.rows();
  RowMatrix forces = RowMatrix::Zero(y.rows(), tangents);
  Index at = 0;
  for (std::size_t i = 0; i < contacts.size(); at += contacts[i++].tangent.rows()) {
    const Contact& c = contacts[i];
    const ContactRows& r = rows[i];
    if (r.friction < 0) continue;
    if (r.state >= 0) {
      forces.col(at) = -x.col(r.state);
    } else if (c.facets > 0) {
      forces.middleCols(at, 2) = y.middleCols(r.friction, c.facets) * directions(c.facets);
    } else if (is_circle(c)) {
      forces.middleCols(at, 2) = y.middleCols(circle_row(r), 2);
    } else {
      forces.col(at) = y.col(r.friction);
      if (r.normal >= 0)
        forces.col(at) -= c.mu * y.col(r.normal);
      else
        for (Index j = 0; j < y.rows(); ++j) forces(j, at) -= value_of(c.bound, t[j]);
    }
  }
  return forces;
}

}  // namespace bromwich
