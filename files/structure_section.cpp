#include "files/structure_section.hpp"

#include "core/base/error.hpp"
#include "files/reference_section.hpp"
#include "files/scene_matrices.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

namespace bromwich {

namespace {

/// Contacts that read other members than their own keys say: normal, tangent, ... are the keys.
constexpr const char* contact_members[] = {"name",   "normal",      "tangent", "gap", "velocity", "bound",
                                           "facets", "restitution", "mu",      "kn",  "kt"};

void refuse_others(const Sections& s) {
  const std::array<std::pair<const Section*, const char*>, 6> others{{{&s.dynamics, "A"},
                                                                      {&s.kronecker, "points"},
                                                                      {&s.complementarity, "N"},
                                                                      {&s.port, "J"},
                                                                      {&s.boundary, "E0"},
                                                                      {&s.free, "rows"}}};
  for (const auto& [section, key] : others)
    if (section->given())
      throw Error(section->where(key), "is given with a section [structure]",
                  "leave it out: [structure], [[contact]] and [relay] say it all");
}

/// Coordinates, as far as matrices and vectors tell; 0: they do not.
Index coordinates(const Sections& s) {
  for (const char* key : {"M", "C", "K"})
    if (s.structure.has_rows(key)) return sparse_value(s.structure.matrix(key)).rows();
  for (const char* key : {"q0", "v0"})
    if (s.structure.has(key)) return s.structure.vector(key).size();
  for (const Section& contact : s.contacts)
    if (contact.has("normal")) return contact.vector("normal").size();
  return 0;
}

Structure read_structure(const Sections& s, Draft& draft) {
  const Section& section = s.structure;
  Index d = coordinates(s);
  Structure made;
  made.T = draft.scene.T;
  made.M = sparse_value(section.matrix("M", d, d));
  d = made.M.rows();
  for (const auto& [key, m] : {std::pair("C", &made.C), {"K", &made.K}})
    if (section.has(key)) *m = sparse_value(section.matrix(key, d, d));
  const FunctionValue f = section.function("f", made.T, d);
  require_entries(f, d, section.where("f"), "one per coordinate");
  draft.note(f.switches);
  made.f = f.function;
  for (const auto& [key, v] : {std::pair("q0", &made.q0), {"v0", &made.v0}})
    if (section.has(key)) *v = section.vector(key, d);
  made.periodic = section.flag("periodic");
  made.names = section.texts("names", d);
  return made;
}

Contact read_contact(const Section& section, Index d, Draft& draft) {
  Contact c;
  c.name = section.text("name", "");
  if (section.has("normal")) c.normal = section.vector("normal", d);
  if (section.has("tangent")) c.tangent = section.row_or_rows("tangent", d);
  const auto function = [&](const char* key, Index size) {
    const FunctionValue value = section.function(key, draft.scene.T, size);
    require_entries(value, size, section.where(key), size == 1 ? "one" : "one per tangent");
    draft.note(value.switches);
    return value.function;
  };
  c.gap = function("gap", 1);
  c.bound = function("bound", 1);
  c.velocity = function("velocity", std::max<Index>(c.tangent.rows(), 1));
  for (const auto& [key, value] :
       {std::pair("mu", &c.mu), {"restitution", &c.restitution}, {"kn", &c.kn}, {"kt", &c.kt}})
    if (const auto given = section.optional_number(key)) {
      if (*given == 0 && (value == &c.kn || value == &c.kt))
        throw Error(section.where(key), "is 0", "give a positive stiffness, or leave it out for a rigid contact");
      *value = *given;
    }
  c.facets = section.positive_integer("facets", 0);
  return c;
}

Places places_of(const Sections& s) {
  Places where;
  for (const char* key : {"M", "C", "K", "f", "q0", "v0", "names", "B"}) where[key] = s.structure.where(key);
  for (std::size_t i = 0; i < s.contacts.size(); ++i)
    for (const char* member : contact_members)
      where[fmt::format("contacts[{}].{}", i, member)] = s.contacts[i].where(member);
  for (const char* key : {"e", "bound"}) where[key] = s.relay.where(key);
  where["relay.C"] = s.relay.where("C");
  where["T"] = s.time.where("T");
  return where;
}

Relays read_relays(const Sections& s, Index d, Draft& draft) {
  Relays r;
  r.B = dense_value(s.structure.matrix("B"), s.structure.where("B"));
  r.C = dense_value(s.relay.matrix("C"), s.relay.where("C"));
  const Index k = r.C.rows();
  if (r.C.cols() != 2 * d)
    throw Error(s.relay.where("C"), fmt::format("has {} columns for {} coordinates", r.C.cols(), d),
                "give one for each coordinate and then one for each velocity");
  if (r.B.rows() != d || r.B.cols() != k)
    throw Error(s.structure.where("B"), fmt::format("is {} x {}", r.B.rows(), r.B.cols()),
                fmt::format("make it coordinates x relays = {} x {}", d, k));
  for (const auto& [key, value] : {std::pair("e", &r.e), {"bound", &r.bound}}) {
    const FunctionValue read = s.relay.function(key, draft.scene.T, k);
    require_entries(read, k, s.relay.where(key), "one per row of C");
    draft.note(read.switches);
    *value = read.function;
  }
  return r;
}

}  // namespace

std::shared_ptr<const Mechanism> read_mechanism(const Sections& s, Draft& draft) {
  if (!s.structure.given())
    throw Error(s.contacts.front().where("normal"), "is given without [structure]",
                "add a section [structure] with M, C, K and f");
  refuse_others(s);
  if (s.structure.has("B") && !s.relay.given())
    throw Error(s.structure.where("B"), "is given without [relay]", "add a section [relay] with C, or leave it out");
  const auto mechanism = std::make_shared<Mechanism>();
  in_the_file([&] { return places_of(s); },
              [&] {
                Structure structure = read_structure(s, draft);
                const Index d = structure.M.rows();
                std::vector<Contact> contacts;
                for (const Section& contact : s.contacts) contacts.push_back(read_contact(contact, d, draft));
                const Relays relays = s.relay.given() ? read_relays(s, d, draft) : Relays();
                *mechanism = make_mechanism(std::move(structure), std::move(contacts), relays);
              });
  return mechanism;
}

}  // namespace bromwich
