#include "app/mechanism_output.hpp"

#include <fmt/format.h>

#include <iterator>

namespace bromwich::app {

namespace {

const char* word(ContactState state) {
  return state == ContactState::open ? "open" : state == ContactState::stick ? "stick" : "slip";
}

Json list(const Vector& v) { return std::vector<double>(v.begin(), v.end()); }

void add_json(const Mechanism& m, const ContactReport& report, Json& object) {
  Json contacts = Json::object();
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    const ContactSummary& c = report.contacts[i];
    Json phases = Json::array(), impacts = Json::array();
    for (const ContactPhase& p : report.phases)
      if (p.contact == Index(i)) phases.push_back({{"begin", p.begin}, {"end", p.end}, {"state", word(p.state)}});
    for (const ContactImpact& p : report.impacts)
      if (p.contact == Index(i))
        impacts.push_back({{"t", p.t},
                           {"normal", p.normal},
                           {"friction", list(p.friction)},
                           {"loss", p.loss},
                           {"friction_loss", p.friction_loss}});
    contacts[m.contacts[i].name] = {{"stick", c.stick},
                                    {"slip", c.slip},
                                    {"open", c.open},
                                    {"normal_impulse", c.normal_impulse},
                                    {"friction_impulse", list(c.friction_impulse)},
                                    {"largest_normal", c.largest_normal},
                                    {"friction_loss", c.friction_loss},
                                    {"impact_loss", c.impact_loss},
                                    {"phases", phases},
                                    {"impacts", impacts}};
  }
  object["contacts"] = contacts;
  object["coordinates"] = m.coordinates();
  const MechanicalEnergy& e = report.energy;
  object["energy"] = {{"located", report.located}, {"initial", e.initial}, {"supplied", e.supplied},
                      {"stored", e.stored},        {"damping", e.damping}, {"friction", e.friction},
                      {"impacts", e.impacts},      {"error", e.error}};
}

}  // namespace

std::optional<ContactReport> report_on_contacts(const Mechanism& m, const Result& result, Json& object) {
  if (!has_contact_report(m, result)) return std::nullopt;
  ContactReport report = contact_report(m, result);
  add_json(m, report, object);
  return report;
}

std::vector<std::string> contact_names(const Mechanism* m) {
  return m ? contact_column_names(*m) : std::vector<std::string>{};
}

std::vector<TimeSeries> contact_series(const Mechanism& m, const ContactReport& report, const Result& rows) {
  std::vector<TimeSeries> series;
  for (ContactColumn& column : contact_columns(m, report, rows.t, rows.x, rows.y))
    series.push_back({std::move(column.name), std::move(column.meaning), std::move(column.values)});
  return series;
}

std::string mechanism_text(const Mechanism& m, const ContactReport& report) {
  std::string text;
  const auto line = [&text](const std::string& label, const std::string& value) {
    fmt::format_to(std::back_inserter(text), "{:<11} {}\n", label, value);
  };
  constexpr std::size_t most = 16;
  for (std::size_t i = 0; i < m.contacts.size(); ++i) {
    if (i == most) {
      line("", fmt::format("... ({} more contacts in --json)", m.contacts.size() - most));
      break;
    }
    const ContactSummary& c = report.contacts[i];
    const std::string impacts =
        c.impacts == 0 ? "" : fmt::format(", {} impact{} {:.6g}", c.impacts, c.impacts == 1 ? "" : "s", c.impact_loss);
    line(m.contacts[i].name,
         fmt::format("stick {:.6g}, slip {:.6g}, open {:.6g}; impulse {:.6g}; losses: friction {:.6g}{}", c.stick,
                     c.slip, c.open, c.normal_impulse, c.friction_loss, impacts));
  }
  const MechanicalEnergy& e = report.energy;
  line("energy", fmt::format("{:.6g} at 0 + {:.6g} supplied = {:.6g} at T + {:.6g} damping + {:.6g} friction + {:.6g} "
                             "impacts, to {:.1e}{}",
                             e.initial, e.supplied, e.stored, e.damping, e.friction, e.impacts, e.error,
                             report.located ? "" : " (from the rows)"));
  return text;
}

}  // namespace bromwich::app
