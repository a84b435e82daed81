// Tables within a section.

#include "core/base/error.hpp"
#include "files/section.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

namespace bromwich {

namespace {

std::vector<std::string> in_file_order(const toml::table& table) {
  std::vector<std::tuple<toml::source_index, toml::source_index, std::string>> found;
  for (const auto& [key, node] : table)
    found.emplace_back(key.source().begin.line, key.source().begin.column, std::string(key.str()));
  std::sort(found.begin(), found.end());
  std::vector<std::string> keys;
  for (const auto& [line, column, key] : found) keys.push_back(key);
  return keys;
}

}  // namespace

std::vector<std::string> Section::keys() const { return table_ ? in_file_order(*table_) : std::vector<std::string>(); }

Section Section::table(const std::string& key, const std::vector<std::string>& keys) const {
  const toml::table* found = require(key).as_table();
  if (!found) throw Error(where(key), "found " + kind(require(key)), "give a table in braces");
  return Section(*document_, found, name_ + "." + key, keys);
}

std::vector<Section> Section::tables(const std::string& key, const std::vector<std::string>& keys) const {
  std::vector<Section> all;
  const toml::node& node = require(key);
  const auto add = [&](const toml::node& one, const std::string& name) {
    const toml::table* found = one.as_table();
    if (!found) throw Error(where(one, name), "found " + kind(one), "give a table with " + join(keys));
    all.emplace_back(*document_, found, name_ + "." + name, keys);
  };
  if (const toml::table* table = node.as_table()) {
    for (const std::string& name : in_file_order(*table)) add(*table->get(name), key + "." + one_line(name));
  } else {
    const toml::array& list = require_list(key, "give a list of tables in braces");
    for (std::size_t i = 0; i < list.size(); ++i) add(list[i], fmt::format("{}[{}]", key, i));
  }
  return all;
}

}  // namespace bromwich
