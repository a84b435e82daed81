#pragma once
// Linear structures with contacts, as mechanics states them:
//
//     M q'' + C q' + K q = f(t) + Σ Hn^T ln + Ht^T lt,    q(0) = q0,  q'(0) = v0.
//
// Of each contact, with the gap gn = Hn q + g(t) and the sliding velocity vt = Ht q' - V(t):
//
//     normal     0 <= ln  ⊥  gn + ln / kn >= 0              kn: its stiffness; rigid: gn >= 0
//     friction   |lt| <= R,  lt = -R sgn vt where it slips  R = mu ln, or a given bound R(t)
//     Jenkins    lt' = -kt vt where |lt| < R                 a spring kt in series with the friction
//     impact     gn'+ = -e gn'-                              Newton's law with the restitution e, of rigid contacts
//
// symbol  variable             shape   meaning
// M,C,K   Structure::M, C, K   d x d   mass (symmetric, positive definite), damping, stiffness
// Hn      Contact::normal      d       row of the gap; opening is positive
// Ht      Contact::tangent     1 x d   row of the sliding velocity; 2 x d in space, on a circle or with facets
//
// As a linear complementarity system with x = (q, q', l of Jenkins elements), a contact has these rows:
//
//     contact           y                        w
//     no friction       ln                       gn + ln / kn
//     planar            ln, b, c                 gn + ln / kn,  vt + c,  2 mu ln - b         lt = b - mu ln
//     given bound       b, c                     vt + c,  2 R - b                            lt = b - R
//     Jenkins           (ln,) s+, s-             (gn + ln / kn,)  R + lt,  R - lt            lt' = -kt (vt - s+ + s-)
//     facets            (ln,) l_1 ... l_k, c     (gn + ln / kn,)  d_i·vt + c,  R - Σ l_i     lt = Σ d_i l_i
//     circle            ln, lt                   gn,  vt                                     Scene::cones
//     its given bound   R, lt                    0,  vt

#include "result.hpp"
#include "scene.hpp"
#include "types.hpp"

#include <string>
#include <vector>

namespace bromwich {

struct Structure {
  std::string name;
  SparseMatrix M, C, K;   ///< C and K may be empty: 0
  TimeFunction f;         ///< d values; empty = 0
  Vector q0, v0;          ///< d values; empty = 0
  bool periodic = false;  ///< q(0) = q(T) and q'(0) = q'(T) instead of q0 and v0
  double T = 1;
  std::vector<std::string> names;  ///< of the coordinates; empty: q0, q1, ...
  /// Times at which f, or g, V and R of a contact, may jump or have a kink; see Scene.
  std::vector<double> breakpoints;
  bool breakpoints_are_all = false;
};

struct Contact {
  std::string name;       ///< empty: c0, c1, ... by its place
  Vector normal;          ///< Hn; empty: friction alone, with `bound`
  Matrix tangent;         ///< Ht; empty: no friction
  TimeFunction gap;       ///< g, 1 value; empty = 0
  TimeFunction velocity;  ///< V of the other body, a value for each tangent; empty = 0
  TimeFunction bound;     ///< R >= 0, 1 value: friction of a given normal force, in place of mu ln
  double mu = 0;
  double restitution = 0;  ///< e in [0, 1]
  double kn = 0, kt = 0;   ///< 0: rigid
  Index facets = 0;        ///< in space: directions d_i of friction, an even number; 0: a circle, |lt| <= R
};

/// Where a contact is in y and w, and its Jenkins force in x; -1: nowhere.
struct ContactRows {
  Index normal = -1;    ///< of ln and the gap
  Index friction = -1;  ///< first row of the friction; on a circle with a given bound that of the bound
  Index state = -1;     ///< x[state] = -lt
};

/// Forces B l on the coordinates with l_i in -bound_i(t) Sgn((C (q, q') + e(t))_i), as of relay_scene.
struct Relays {
  Matrix B;            ///< d x k; empty: none
  Matrix C;            ///< k x 2d
  TimeFunction e;      ///< k values; empty = 0
  TimeFunction bound;  ///< k values; empty = 1
};

struct Mechanism {
  Structure structure;
  std::vector<Contact> contacts;
  std::vector<ContactRows> rows;  ///< of each contact
  Relays relays;
  Scene scene;

  Index coordinates() const { return structure.M.rows(); }  ///< d
  /// Rows of y x contacts.
  RowMatrix normal_forces(const RowMatrix& y) const;
  /// The friction forces lt of all tangents of all contacts, at the times t of these rows of x (all states) and y.
  RowMatrix friction_forces(const Vector& t, const RowMatrix& x, const RowMatrix& y) const;
};

/// The scene of a structure with contacts: dense up to 200 states, otherwise sparse with E = diag(I, M). Rows of relays
/// (2k) come before those of contacts. Throws Error naming the member, of a contact as "contacts[1].mu".
Mechanism make_mechanism(Structure, std::vector<Contact>, const Relays& = {});

/// What a contact does for a while.
enum class ContactState : char { open, stick, slip };
struct ContactPhase {
  Index contact = 0;
  double begin = 0, end = 0;
  ContactState state = ContactState::open;  ///< without friction: open, or slip while it is closed
};

struct ContactImpact {
  Index contact = 0;
  double t = 0;
  double normal = 0;         ///< impulse pn
  Vector friction;           ///< pt, of each tangent
  double loss = 0;           ///< energy, by pn; negative where Newton's law with friction raises it
  double friction_loss = 0;  ///< energy, by pt
};

/// Of one contact over [0, T].
struct ContactSummary {
  double open = 0, stick = 0, slip = 0;  ///< times
  double normal_impulse = 0;             ///< integral of ln, impacts included
  Vector friction_impulse;               ///< integral of lt
  double largest_normal = 0;             ///< ln outside impacts
  Index impacts = 0;
  double friction_loss = 0, impact_loss = 0;  ///< energies: by lt and pt, by pn
};

/// initial + supplied = stored + damping + friction + impacts, but for `error`.
struct MechanicalEnergy {
  double initial = 0, stored = 0;  ///< kinetic and potential energy at 0 and at T, of compliant contacts too
  double supplied = 0;  ///< by f, by moving bodies, by relays, and by the skew part of K (circulatory forces)
  double damping = 0, friction = 0, impacts = 0;
  double error = 0;  ///< relative to the largest of these
};

struct ContactReport {
  bool located = false;  ///< by located events; otherwise from the rows, with the order of the steps
  std::vector<ContactSummary> contacts;
  std::vector<ContactPhase> phases;    ///< of each contact in order of time
  std::vector<ContactImpact> impacts;  ///< in order of time
  MechanicalEnergy energy;
};

/// Of a solved result with located switches, or with all states. Throws Error where steps have not recorded them.
ContactReport contact_report(const Mechanism&, const Result&);

/// Whether a result is solved, with all states, and with located switches or all rows of its steps.
bool has_contact_report(const Mechanism&, const Result&);

/// A number of a contact at each row of a result.
struct ContactColumn {
  std::string name, meaning;
  Vector values;
};

/// lt along each tangent ("c0.lt", of two tangents "c0.lt0", "c0.lt1") and what each contact does ("c0.state"), on rows
/// of a result, or of others at times between. `x` has all states. Beside jumps of lt as y is, on the same side.
std::vector<ContactColumn> contact_columns(const Mechanism&, const ContactReport&, const Vector& t, const RowMatrix& x,
                                           const RowMatrix& y);
/// Their names.
std::vector<std::string> contact_column_names(const Mechanism&);

}  // namespace bromwich
