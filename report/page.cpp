#include "report/page.hpp"

#include "report/page_parts.hpp"
#include "report/page_style.hpp"
#include "report/scale.hpp"

#include <fmt/format.h>

namespace bromwich::report {

namespace {

std::string title(const Report& report) {
  const std::string scene = text_at(report.summary, "scene");
  return scene.empty() ? report.source : scene;
}

std::string summary_part(const Report& report) {
  if (!report.summary.is_object()) return "";
  const std::string text = report.summary.dump(2, ' ', false, Json::error_handler_t::replace);
  return fmt::format(
      "<details><summary>All numbers, as <code>bromwich solve --json</code> prints them</summary>\n"
      "<pre id=\"summary\">{}</pre></details>\n",
      escaped(text));
}

}  // namespace

std::string page(const Report& report) {
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n"
      "<meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{0} – bromwich</title>\n<style>\n{1}</style>\n"
      "</head>\n<body>\n<main>\n<h1>{0}</h1>\n",
      escaped(title(report)), page_style);
  for (const auto part : {outcome_part, facts_part, certificate_part, contacts_part, curves_part, active_part,
                          convergence_part, error_part, time_part, summary_part})
    html += part(report);
  html += fmt::format("<footer>{} · bromwich {}</footer>\n</main>\n</body>\n</html>\n", escaped(report.source),
                      escaped(report.version));
  return html;
}

}  // namespace bromwich::report
