// What the contacts of a structure do, where its energy goes, and its coordinates in the phase plane.

#include "report/charts.hpp"
#include "report/page_parts.hpp"
#include "report/page_pieces.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace bromwich::report {

namespace {

constexpr std::size_t most_contacts = 30;  ///< with a bar of their own
constexpr Index most_orbits = 4;

std::string bars_of_contacts(const Report& report, const Json& contacts) {
  const ScaledUnit unit = drawn_time(report);
  TimeBars chart{"what contacts do over time", with_unit("time t", unit.name), 0, 0, {}, {}};
  chart.last = number_at(report.summary, "sizes/T").value_or(0) / unit.size;
  for (const auto& [name, contact] : contacts.items()) {
    if (chart.names.size() == most_contacts) break;
    chart.names.push_back(name);
    std::vector<std::pair<double, double>> dark, light;
    for (const Json& phase : contact["phases"]) {
      const std::string state = phase["state"];
      const std::pair span(phase["begin"].get<double>() / unit.size, phase["end"].get<double>() / unit.size);
      if (state != "open") (state == "stick" ? dark : light).push_back(span);
    }
    chart.bars.push_back(std::move(dark));
    chart.light.push_back(std::move(light));
    chart.ticks.emplace_back();
    for (const Json& impact : contact["impacts"]) chart.ticks.back().push_back(impact["t"].get<double>() / unit.size);
  }
  return figure(time_bars(chart),
                "Dark where a contact sticks, light where it slips or is closed without friction, "
                "empty where it is open. A line stands at each impact.");
}

std::string table_of_contacts(const Json& contacts) {
  constexpr std::array<std::pair<const char*, const char*>, 8> columns{{{"sticks", "stick"},
                                                                        {"slips", "slip"},
                                                                        {"open", "open"},
                                                                        {"normal impulse", "normal_impulse"},
                                                                        {"largest normal force", "largest_normal"},
                                                                        {"loss by friction", "friction_loss"},
                                                                        {"loss by impacts", "impact_loss"},
                                                                        {"impacts", ""}}};
  std::string html = "<table class=\"contacts\">\n<tr><th scope=\"col\">contact</th>";
  for (const auto& column : columns) html += fmt::format("<th scope=\"col\">{}</th>", column.first);
  html += "</tr>\n";
  std::size_t shown = 0;
  for (const auto& [name, contact] : contacts.items()) {
    if (shown++ == most_contacts) break;
    html += fmt::format("<tr><th scope=\"row\">{}</th>", escaped(name));
    for (const auto& column : columns) {
      const double value =
          *column.second ? number_at(contact, column.second).value_or(NAN) : double(contact["impacts"].size());
      html += fmt::format("<td>{}</td>", number(value));
    }
    html += "</tr>\n";
  }
  html += "</table>\n";
  if (contacts.size() > most_contacts)
    html += fmt::format("<p class=\"note\">{} more contacts are not shown.</p>\n", contacts.size() - most_contacts);
  return html;
}

std::string energy_of_contacts(const Json& summary) {
  constexpr std::array<std::pair<const char*, const char*>, 6> parts{{{"stored at 0", "initial"},
                                                                      {"supplied", "supplied"},
                                                                      {"stored at T", "stored"},
                                                                      {"lost by damping", "damping"},
                                                                      {"lost by friction", "friction"},
                                                                      {"lost by impacts", "impacts"}}};
  Table table;
  for (const auto& [words, key] : parts)
    if (const auto value = number_at(summary, std::string("energy/") + key)) table.row(words, number(*value));
  return "<p>Energy: what is stored at 0 and supplied is stored at T or lost.</p>\n" + table.end();
}

// States are coordinates, and then their velocities.
std::string orbits(const Report& report) {
  const Quantity* x = report.table.find("x");
  const Index d = Index(number_at(report.summary, "coordinates").value_or(0));
  if (!x || d == 0 || x->values.cols() < 2 * d) return "";
  std::string pictures;
  for (Index i = 0; i < std::min(d, most_orbits); ++i) {
    const std::string &q = x->names[std::size_t(i)], &v = x->names[std::size_t(d + i)];
    LineChart chart{q + " in the phase plane", {q}, {v}, {}, {}};
    Line line{q, x->values.col(i), x->values.col(d + i)};
    line.orbit = true;
    chart.lines.push_back(std::move(line));
    pictures += line_chart(chart);
  }
  const std::string more = d > most_orbits ? fmt::format(" {} more are not drawn.", d - most_orbits) : "";
  return heading("Phase plane") + figure(pictures, "Coordinates and their velocities." + more);
}

}  // namespace

std::string contacts_part(const Report& report) {
  if (!report.summary.is_object() || !report.summary.contains("contacts")) return "";
  const Json& contacts = report.summary["contacts"];
  if (!contacts.is_object() || contacts.empty()) return "";
  return heading("Contacts") + bars_of_contacts(report, contacts) + table_of_contacts(contacts) +
         energy_of_contacts(report.summary) + orbits(report);
}

}  // namespace bromwich::report
