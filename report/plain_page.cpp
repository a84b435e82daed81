#include "report/plain_page.hpp"

#include "report/page_style.hpp"
#include "report/words.hpp"

#include <fmt/format.h>

#include <cmath>
#include <exception>

namespace bromwich::report {

std::string plain_page(const std::string& title, const std::string& body, const std::string& version) {
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n"
      "<meta name=\"color-scheme\" content=\"light dark\"/>\n<title>{0} – bromwich</title>\n<style>\n{1}</style>\n"
      "</head>\n<body>\n<main>\n<h1>{0}</h1>\n{2}<footer>{0} · bromwich {3}</footer>\n</main>\n</body>\n</html>\n",
      escaped(title), page_style, body, escaped(version));
}

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells{""};
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"')
      cells.back() += line[++i];
    else if (line[i] == '"')
      quoted = !quoted;
    else if (line[i] == ',' && !quoted)
      cells.emplace_back();
    else if (line[i] != '\r')
      cells.back() += line[i];
  }
  return cells;
}

double number_of(const std::string& cell) {
  try {
    return std::stod(cell);
  } catch (const std::exception&) {
    return NAN;
  }
}

}  // namespace bromwich::report
