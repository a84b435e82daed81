// Structures with contacts as scenes.

#include "answer.hpp"
#include "arrays.hpp"
#include "calls.hpp"
#include "core/base/error.hpp"
#include "mechanics/mechanism.hpp"
#include "mechanics/uniqueness.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>

namespace bromwich::python {
namespace {

using Sparse = std::tuple<Index, Index, Array1, Indices, Indices>;  // rows, columns, values, row of each, starts

View owned(RowMatrix found) {
  auto* values = new RowMatrix(std::move(found));
  return view(*values, nb::capsule(values, [](void* p) noexcept { delete static_cast<RowMatrix*>(p); }));
}

SparseMatrix matrix(const std::optional<Sparse>& s) {
  if (!s) return {};
  return std::apply([](Index rows, Index cols, const auto&... parts) { return as_sparse(rows, cols, parts...); }, *s);
}

/// Functions of time, and what a scene keeps of them.
class Sources {
 public:
  TimeFunction take(const Source* s) {
    if (!s) return {};
    breakpoints = merged(breakpoints, s->breakpoints);
    all = all && s->breakpoints_are_all;
    callables.insert(callables.end(), s->callables.begin(), s->callables.end());
    if (s->forget) forget.push_back(s->forget);
    return s->function;
  }
  std::vector<double> breakpoints;
  bool all = true;
  std::vector<Kept> callables;
  std::vector<std::function<void()>> forget;
};

/// name, normal, tangent, gap, velocity, bound, (mu, restitution, kn, kt), facets
using GivenContact = std::tuple<std::string, std::optional<Array1>, std::optional<Array2>, const Source*, const Source*,
                                const Source*, std::vector<double>, Index>;

Contact contact(const GivenContact& given, Sources& sources) {
  const auto& [name, normal, tangent, gap, velocity, bound, numbers, facets] = given;
  Contact c;
  c.name = name;
  if (normal) c.normal = as_vector(*normal);
  if (tangent) c.tangent = as_matrix(*tangent);
  c.gap = sources.take(gap);
  c.velocity = sources.take(velocity);
  c.bound = sources.take(bound);
  c.mu = numbers.at(0), c.restitution = numbers.at(1), c.kn = numbers.at(2), c.kt = numbers.at(3);
  c.facets = facets;
  return c;
}

nb::tuple structure(const std::string& name, const Sparse& M, const std::optional<Sparse>& C,
                    const std::optional<Sparse>& K, const Source* f, const std::optional<Array1>& q0,
                    const std::optional<Array1>& v0, bool periodic, double T, std::vector<std::string> names,
                    const std::vector<GivenContact>& given) {
  Sources sources;
  Structure s;
  s.name = name;
  s.M = matrix(M), s.C = matrix(C), s.K = matrix(K);
  s.f = sources.take(f);
  if (q0) s.q0 = as_vector(*q0);
  if (v0) s.v0 = as_vector(*v0);
  s.periodic = periodic;
  s.T = T;
  s.names = std::move(names);
  std::vector<Contact> contacts;
  for (const GivenContact& one : given) contacts.push_back(contact(one, sources));
  s.breakpoints = sources.breakpoints;
  s.breakpoints_are_all = sources.all;
  const auto mechanism = std::make_shared<Mechanism>(make_mechanism(std::move(s), std::move(contacts)));
  auto model = std::make_shared<Model>(mechanism->scene);
  model->callables = sources.callables;
  model->forget = sources.forget;
  return nb::make_tuple(model, std::shared_ptr<const Mechanism>(mechanism));
}

const char* word(ContactState state) {
  return state == ContactState::open ? "open" : state == ContactState::stick ? "stick" : "slip";
}

std::vector<double> list(const Vector& v) { return {v.begin(), v.end()}; }

ContactReport found_in(const Mechanism& m, const Answer& answer) {
  return interruptible([&] {
    Mechanism of_answer = m;
    of_answer.scene = answer.model->scene;
    return contact_report(of_answer, answer.result);
  });
}

nb::dict report(const Mechanism& m, const Answer& answer) {
  const ContactReport found = found_in(m, answer);
  nb::list contacts, phases, impacts;
  for (const ContactSummary& c : found.contacts)
    contacts.append(nb::make_tuple(c.open, c.stick, c.slip, c.normal_impulse, list(c.friction_impulse),
                                   c.largest_normal, c.impacts, c.friction_loss, c.impact_loss));
  for (const ContactPhase& p : found.phases)
    phases.append(nb::make_tuple(m.contacts[std::size_t(p.contact)].name, p.begin, p.end, word(p.state)));
  for (const ContactImpact& p : found.impacts)
    impacts.append(nb::make_tuple(m.contacts[std::size_t(p.contact)].name, p.t, p.normal, list(p.friction), p.loss,
                                  p.friction_loss));
  const MechanicalEnergy& e = found.energy;
  nb::dict d;
  d["located"] = found.located;
  d["contacts"] = contacts;
  d["phases"] = phases;
  d["impacts"] = impacts;
  d["energy"] = nb::make_tuple(e.initial, e.supplied, e.stored, e.damping, e.friction, e.impacts, e.error);
  return d;
}

nb::list columns(const Mechanism& m, const Answer& answer) {
  const Result& r = answer.result;
  nb::list all;
  if (!has_contact_report(m, r)) return all;
  for (const ContactColumn& column : contact_columns(m, found_in(m, answer), r.t, r.x, r.y))
    all.append(nb::make_tuple(column.name, column.meaning, list(column.values)));
  return all;
}

}  // namespace

void bind_mechanics(nb::module_& m) {
  nb::class_<Mechanism>(m, "Mechanism", "A structure with contacts: where its contacts are in y, w and x.")
      .def_prop_ro("contacts",
                   [](const Mechanism& s) {
                     std::vector<std::string> names;
                     for (const Contact& c : s.contacts) names.push_back(c.name);
                     return names;
                   })
      .def_prop_ro("rows",
                   [](const Mechanism& s) {
                     std::vector<std::tuple<Index, Index, Index>> rows;
                     for (const ContactRows& r : s.rows) rows.emplace_back(r.normal, r.friction, r.state);
                     return rows;
                   })
      .def_prop_ro("coordinates", &Mechanism::coordinates)
      .def("report", &report, nb::arg("answer"))
      .def("columns", &columns, nb::arg("answer"))
      .def(
          "normal_forces", [](const Mechanism& s, const Answer& a) { return owned(s.normal_forces(a.result.y)); },
          nb::arg("answer"))
      .def(
          "friction_forces",
          [](const Mechanism& s, const Answer& a) {
            return owned(s.friction_forces(a.result.t, a.result.x, a.result.y));
          },
          nb::arg("answer"))
      .def_prop_ro("tangents",
                   [](const Mechanism& s) {
                     std::vector<Index> tangents;
                     for (const Contact& c : s.contacts) tangents.push_back(c.tangent.rows());
                     return tangents;
                   })
      .def("uniqueness", [](const Mechanism& s) { return to_string(uniqueness(s)); });
  m.def("structure", &structure, nb::arg("name"), nb::arg("M"), nb::arg("C").none(), nb::arg("K").none(),
        nb::arg("f").none(), nb::arg("q0").none(), nb::arg("v0").none(), nb::arg("periodic"), nb::arg("T"),
        nb::arg("names"), nb::arg("contacts"));
}

}  // namespace bromwich::python
