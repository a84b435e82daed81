// The parts of a page in words, and where the time went.

#include "report/page_parts.hpp"
#include "report/charts.hpp"
#include "report/page_pieces.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace bromwich::report {

std::string outcome_part(const Report& report) {
  const std::string status = text_at(report.summary, "status"), warning = text_at(report.summary, "warning");
  const char* kind = status != "solved" ? (status.empty() ? " doubt" : "") : warning.empty() ? " good" : " doubt";
  std::string html =
      fmt::format("<div class=\"status{}\"><strong>{}</strong> – {}", kind,
                  escaped(status.empty() ? "no summary" : status), escaped(status_sentence(report.summary)));
  if (status.empty() && !report.table.remark.empty())
    html += " " + escaped("The file says: " + report.table.remark + ".");
  if (!warning.empty()) html += fmt::format("<br/><strong>Warning:</strong> {}.", escaped(warning));
  return html + "</div>\n";
}

namespace {

std::string parameters(const Json& summary) {
  std::string words;
  if (!summary.contains("parameters") || !summary["parameters"].is_object()) return words;
  for (const auto& [key, value] : summary["parameters"].items())
    words +=
        (words.empty() ? "" : ", ") + key + " = " + (value.is_number() ? number(value.get<double>()) : value.dump());
  return words;
}

std::string sizes(const Report& report) {
  const Json& s = report.summary;
  const auto n = number_at(s, "sizes/constraints"), m = number_at(s, "sizes/states"), T = number_at(s, "sizes/T"),
             J = number_at(s, "steps");
  if (!n || !m || !T || !J) return "";
  return fmt::format("{:.0f} constraint{}, {:.0f} state{}, {:.0f} time steps up to T = {}", *n, *n == 1 ? "" : "s", *m,
                     *m == 1 ? "" : "s", *J,
                     number(*T) + (report.table.time_unit.empty() ? "" : " " + report.table.time_unit));
}

std::string asked(const Json& s) {
  std::string words;
  const auto add = [&](const std::string& word) { words += (words.empty() ? "" : ", ") + word; };
  if (const std::string method = text_at(s, "requested/method"); !method.empty()) add("method " + method);
  if (const auto tol = number_at(s, "requested/tolerance")) add("error below " + number(*tol));
  if (const auto steps = number_at(s, "requested/steps")) add(fmt::format("{:.0f} steps", *steps));
  if (const auto tol = number_at(s, "requested/iteration_tolerance")) add("iterations to " + number(*tol));
  return words;
}

std::string how(const Json& s) {
  const std::string method = text_at(s, "method"), backend = text_at(s, "backend");
  if (method.empty()) return "";
  const auto threads = number_at(s, "threads");
  return fmt::format("{} on {}{}", method, backend,
                     threads ? fmt::format(", {:.0f} thread{}", *threads, *threads == 1 ? "" : "s") : "");
}

}  // namespace

std::string facts_part(const Report& report) {
  const Json& s = report.summary;
  if (!s.is_object()) {
    const Index rows = report.table.t.size();
    return heading("What the file has") + fmt::format("<p>{} rows, {} columns beside the time.</p>\n", rows, [&] {
             std::size_t columns = 0;
             for (const Quantity& q : report.table.quantities) columns += q.names.size();
             return columns;
           }());
  }
  Table table;
  table.row("scene", text_at(s, "scene"));
  table.row("parameters", parameters(s));
  table.row("size", sizes(report));
  table.row("class of M", text_at(s, "class"));
  table.row("spectrum of A", text_at(s, "spectrum"));
  table.row("requested", asked(s));
  table.row("method", how(s));
  table.rows("what was decided", words_at(s, "decisions"));
  table.row("kernel", text_at(s, "kernel"));
  if (number_at(s, "sizes/constraints") == 0.0) return heading("What was solved") + table.end();
  return heading("What was solved") +
         "<p class=\"note\">E x′ = A x + B y + f(t), 0 ≤ y ⊥ w = N x + M y + g(t) ≥ 0: at every time each "
         "constraint has y = 0 or w = 0.</p>\n" +
         table.end();
}

std::string certificate_part(const Report& report) {
  const std::vector<Certificate> list = certificates(report.summary);
  if (list.empty()) return "";
  std::string rows;
  for (const Certificate& c : list)
    rows += fmt::format("<tr><th scope=\"row\">{}</th><td class=\"number\">{}</td><td>{}</td></tr>\n", escaped(c.name),
                        escaped(c.value), escaped(c.meaning));
  return heading("What was checked") + "<table>\n" + rows + "</table>\n";
}

std::string time_part(const Report& report) {
  const Json& s = report.summary;
  const auto total = number_at(s, "seconds/total");
  if (!total || !(*total > 0)) return "";
  const auto part = [&](const char* key) { return number_at(s, std::string("seconds/") + key).value_or(0); };
  const double certification = std::min(part("certification"), part("other"));
  const std::vector<std::pair<const char*, double>> parts{
      {"set-up", part("setup")},
      {"complementarity problems, marching", part("lcp")},
      {"convolution with the kernel", part("convolution")},
      {"sine transforms", part("transform")},
      {"certification: checks and solves to confirm", certification},
      {"other", part("other") - certification}};
  std::vector<double> values;
  std::string rows;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& [name, seconds] = parts[i];
    values.push_back(std::max(0., seconds));
    rows += fmt::format(
        "<tr><th scope=\"row\"><svg class=\"swatch\" viewBox=\"0 0 10 10\" aria-hidden=\"true\"><rect "
        "class=\"part-{}\" width=\"10\" height=\"10\"/></svg>{}</th><td class=\"number\">{} "
        "s</td><td>{:.0f} %</td></tr>\n",
        i, name, short_number(seconds, 3), 100 * seconds / *total);
  }
  std::string words = fmt::format("{} s in total.", short_number(*total, 3));
  const auto bytes = number_at(s, "bytes"), predicted = number_at(s, "bytes_predicted");
  if (bytes) words += fmt::format(" Arrays and plans took {} MB", short_number(*bytes * 1e-6, 3));
  if (bytes && predicted && *predicted > 0)
    words += fmt::format(", predicted were {} MB", short_number(*predicted * 1e-6, 3));
  if (bytes) words += ".";
  return heading("Time and memory") + figure(parts_of_whole("parts of the time", values), words) +
         "<table class=\"times\">\n" + rows + "</table>\n";
}

}  // namespace bromwich::report
