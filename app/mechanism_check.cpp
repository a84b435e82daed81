#include "app/mechanism_check.hpp"

#include "mechanics/uniqueness.hpp"

#include <fmt/format.h>

namespace bromwich::app {

namespace {

std::string friction_text(const Contact& c) {
  if (c.tangent.rows() == 0 || (c.mu == 0 && !c.bound)) return "no friction";
  const std::string bound = c.bound ? "friction of a given bound" : fmt::format("friction with mu = {:.6g}", c.mu);
  const std::string in_space = c.facets > 0            ? fmt::format(" on {} facets", c.facets)
                               : c.tangent.rows() == 2 ? " on a circle"
                                                       : "";
  return bound + in_space + (c.kt > 0 ? fmt::format(", a Jenkins element with kt = {:.6g}", c.kt) : "");
}

std::string contact_text(const Contact& c) {
  if (c.normal.size() == 0) return friction_text(c);
  const std::string normal = c.kn > 0            ? fmt::format("compliant with kn = {:.6g}", c.kn)
                             : c.restitution > 0 ? fmt::format("rigid with e = {:.6g}", c.restitution)
                                                 : "rigid";
  return normal + ", " + friction_text(c);
}

const char* sentence_of(Uniqueness u) {
  switch (u) {
    case Uniqueness::unique:
      return "one solution: the problem of velocities is of class P";
    case Uniqueness::forces_open:
      return "one motion, forces may be several: normals or tangents of contacts depend on each other";
    case Uniqueness::none_known:
      return "not known to have one solution: friction is large beside the coupling of normals and tangents";
    case Uniqueness::too_many:
      break;
  }
  return "not looked at: too many contacts, or friction in space";
}

}  // namespace

std::vector<std::pair<std::string, std::string>> mechanism_facts(const Mechanism& m) {
  std::vector<std::pair<std::string, std::string>> facts;
  const std::string relays = m.scene.relays > 0 ? fmt::format(", {} relays", m.scene.relays) : "";
  facts.emplace_back("structure", fmt::format("{} coordinates, {} contact{}{}", m.coordinates(), m.contacts.size(),
                                              m.contacts.size() == 1 ? "" : "s", relays));
  constexpr std::size_t most = 12;
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    if (i == most) {
      facts.emplace_back("", fmt::format("... ({} more)", m.contacts.size() - most));
      break;
    }
    facts.emplace_back("contact", m.contacts[i].name + ": " + contact_text(m.contacts[i]));
  }
  if (!m.contacts.empty()) facts.emplace_back("uniqueness", sentence_of(uniqueness(m)));
  return facts;
}

Json mechanism_json(const Mechanism& m) {
  Json contacts = Json::array();
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    const Contact& c = m.contacts[i];
    const ContactRows& r = m.rows[i];
    const auto row = [](Index k) { return k < 0 ? Json(nullptr) : Json(k); };
    contacts.push_back({{"name", c.name},
                        {"kind", contact_text(c)},
                        {"normal_row", row(r.normal)},
                        {"friction_row", row(r.friction)},
                        {"spring_state", row(r.state)}});
  }
  return {{"coordinates", m.coordinates()}, {"uniqueness", to_string(uniqueness(m))}, {"contacts", contacts}};
}

}  // namespace bromwich::app
