#include "files/stored_result.hpp"

#include "core/base/error.hpp"

#include <tuple>

namespace bromwich {

std::string StoredResult::text(const std::string& name) const {
  for (const auto& [key, fact] : facts)
    if (const auto* words = std::get_if<std::string>(&fact); words && key == name) return *words;
  return "";
}

void require_rows(const FileTarget& target, const StoredResult& stored) {
  const std::string name = "'" + target.path.string() + "' ";
  for (const auto& [symbol, values, names] : {std::tuple("y", &stored.y, &stored.constraint_names),
                                              {"w", &stored.w, &stored.constraint_names},
                                              {"x", &stored.x, &stored.state_names}}) {
    if (values->size() == 0) continue;
    if (values->rows() != stored.t.size())
      throw Error(target.argument,
                  name + "has " + std::to_string(values->rows()) + " rows of " + symbol + " and " +
                      std::to_string(stored.t.size()) + " times",
                  "give a file that 'bromwich solve --out' has written");
    if (!names->empty() && Index(names->size()) != values->cols())
      throw Error(target.argument, name + "has other names than columns of " + symbol,
                  "give a file that 'bromwich solve --out' has written");
  }
}

}  // namespace bromwich
