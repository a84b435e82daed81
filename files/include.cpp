#include "files/include.hpp"

#include "core/base/error.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

constexpr const char* include_remedy = "give a list of files such as [\"common.toml\"]";

toml::table parse_toml(std::string_view text, const std::string& name) {
  try {
    return toml::parse(text, name);
  } catch (const toml::parse_error& error) {
    throw Error(fmt::format("{}:{}", name, error.source().begin.line), one_line(error.description()),
                "correct the TOML of this line");
  }
}

std::vector<std::string> in_file_order(const toml::table& table) {
  std::vector<std::pair<toml::source_position, std::string>> found;
  for (const auto& [key, node] : table) found.emplace_back(key.source().begin, key.str());
  std::sort(found.begin(), found.end());
  std::vector<std::string> keys;
  for (const auto& [position, key] : found) keys.push_back(key);
  return keys;
}

/// `added` replaces single keys of sections, and whole keys that are no sections.
void merge(toml::table& into, toml::table&& added) {
  for (auto&& [key, node] : added) {
    toml::table *old = into.get_as<toml::table>(key.str()), *section = node.as_table();
    if (!old || !section) {
      node.visit([&into, &key = key](auto& value) { into.insert_or_assign(key, std::move(value)); });
      continue;
    }
    for (auto&& [inner_key, inner] : *section)
      inner.visit([old, &inner_key = inner_key](auto& value) { old->insert_or_assign(inner_key, std::move(value)); });
  }
}

class Includes {
 public:
  explicit Includes(Document& document) : document_(document) {}

  toml::table read(std::string_view text, const std::string& name, const std::filesystem::path& path) {
    std::error_code none;
    open_.push_back(std::filesystem::weakly_canonical(path, none));
    toml::table own = parse_toml(text, name);
    document_.folders[name] = path.parent_path();
    toml::table all;
    if (const toml::node* list = own.get("include")) {
      const std::string where = fmt::format("{}:{}: include", name, list->source().begin.line);
      for (const std::string& file : names(*list, where)) merge(all, included(file, path.parent_path(), where));
      own.erase("include");
    }
    for (const char* section : {"parameters", "definitions"})
      if (const toml::table* table = own.get_as<toml::table>(section))
        for (const std::string& key : in_file_order(*table)) {
          auto& order = document_.order[section];
          if (std::find(order.begin(), order.end(), key) == order.end()) order.push_back(key);
        }
    merge(all, std::move(own));
    open_.pop_back();
    return all;
  }

 private:
  static std::vector<std::string> names(const toml::node& node, const std::string& where) {
    if (const auto* text = node.as_string()) return {text->get()};
    if (!node.is_array()) throw Error(where, "found " + kind(node), include_remedy);
    std::vector<std::string> found;
    for (const toml::node& entry : *node.as_array()) {
      const auto* text = entry.as_string();
      if (!text) throw Error(where, "found " + kind(entry), include_remedy);
      found.push_back(text->get());
    }
    return found;
  }

  toml::table included(const std::string& file, const std::filesystem::path& folder, const std::string& where) {
    const std::filesystem::path path = folder / file;
    std::error_code none;
    if (std::find(open_.begin(), open_.end(), std::filesystem::weakly_canonical(path, none)) != open_.end())
      throw Error(where, fmt::format("'{}' includes itself, directly or through other files", one_line(file)),
                  "remove one of these includes");
    const std::string name = one_line(path.string());
    const std::string text = read_text({path.string(), path}, where);
    document_.read.push_back(path);
    return read(text, name, path);
  }

  Document& document_;
  std::vector<std::filesystem::path> open_;  ///< files being read, the including ones first
};

}  // namespace

toml::table read_with_includes(Document& document, std::string_view toml, const std::filesystem::path& path) {
  return Includes(document).read(toml, document.name, path);
}

}  // namespace bromwich
