#include "mechanics/mechanism.hpp"

#include <algorithm>

namespace bromwich {

namespace {

std::vector<std::string> names_of_friction(const Contact& c) {
  if (c.tangent.rows() == 1) return {c.name + ".lt"};
  std::vector<std::string> names;
  for (Index k = 0; k < c.tangent.rows(); ++k) names.push_back(c.name + ".lt" + std::to_string(k));
  return names;
}

/// At t, where two phases meet that of the one before, as rows of located events are.
double state_at(double t, const std::vector<ContactPhase>& phases) {
  if (phases.empty()) return double(ContactState::open);
  const auto found = std::lower_bound(phases.begin(), phases.end(), t,
                                      [](const ContactPhase& phase, double at) { return phase.end < at; });
  return double((found == phases.end() ? phases.back() : *found).state);
}

}  // namespace

std::vector<std::string> contact_column_names(const Mechanism& m) {
  std::vector<std::string> names;
  for (const Contact& c : m.contacts) {
    for (std::string& name : names_of_friction(c)) names.push_back(std::move(name));
    names.push_back(c.name + ".state");
  }
  return names;
}

std::vector<ContactColumn> contact_columns(const Mechanism& m, const ContactReport& report, const Vector& t,
                                           const RowMatrix& x, const RowMatrix& y) {
  const RowMatrix friction = m.friction_forces(t, x, y);
  std::vector<std::vector<ContactPhase>> phases(m.contacts.size());
  for (const ContactPhase& phase : report.phases) phases[std::size_t(phase.contact)].push_back(phase);
  std::vector<ContactColumn> columns;
  Index tangent = 0;
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    for (std::string& name : names_of_friction(m.contacts[i]))
      columns.push_back({std::move(name), "friction on the structure", friction.col(tangent++)});
    Vector states(t.size());
    for (Index j = 0; j < t.size(); ++j) states[j] = state_at(t[j], phases[i]);
    columns.push_back({m.contacts[i].name + ".state", "0 open, 1 stick, 2 slip", std::move(states)});
  }
  return columns;
}

}  // namespace bromwich
