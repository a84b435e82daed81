#include "app/columns.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/scene/component_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>

namespace bromwich::app {

namespace {

Index count(const Scene& scene, ColumnKind kind) {
  if (kind == ColumnKind::mode) return Index(scene.memories.size());
  return kind == ColumnKind::x ? scene.states() : scene.constraints();
}

std::string name_of(const Scene& scene, ColumnKind kind, Index component) {
  switch (kind) {
    case ColumnKind::y:
      return multiplier_name(scene, component);
    case ColumnKind::w:
      return slack_name(scene, component);
    case ColumnKind::trace:
      return fmt::format("trace{}", component);
    case ColumnKind::mode:
      return scene.memories[std::size_t(component)].name;
    case ColumnKind::x:
    case ColumnKind::contact:
      break;
  }
  return state_name(scene, component);
}

const std::vector<std::pair<std::string, ColumnKind>> kinds{{"y", ColumnKind::y},
                                                            {"w", ColumnKind::w},
                                                            {"trace", ColumnKind::trace},
                                                            {"x", ColumnKind::x},
                                                            {"mode", ColumnKind::mode}};

/// The column with this name, or with this number where no column has it as its name.
std::optional<Column> find_column(const Scene& scene, const std::string& word) {
  for (const bool by_name : {true, false})
    for (const auto& [letter, kind] : kinds)
      for (Index i = 0; i < count(scene, kind); ++i)
        if (const std::string name = name_of(scene, kind, i); word == (by_name ? name : fmt::format("{}{}", letter, i)))
          return Column{kind, i, name};
  return std::nullopt;
}

std::vector<std::string> known_words(const Scene& scene, const std::vector<std::string>& contacts) {
  std::vector<std::string> words;
  for (const auto& [word, kind] : kinds)
    if (kind != ColumnKind::mode || !scene.memories.empty()) words.push_back(word);
  for (const Memory& memory : scene.memories) words.push_back(memory.name);
  for (const auto* names : {&scene.names.y, &scene.names.w, &scene.names.x})
    words.insert(words.end(), names->begin(), names->end());
  if (!contacts.empty()) words.emplace_back("contact");
  words.insert(words.end(), contacts.begin(), contacts.end());
  return words;
}

std::vector<Column> contact_columns_of(const std::string& word, const std::vector<std::string>& contacts) {
  std::vector<Column> columns;
  for (std::size_t k = 0; k < contacts.size(); ++k)
    if (word == "contact" || word == contacts[k]) columns.push_back({ColumnKind::contact, Index(k), contacts[k]});
  return columns;
}

}  // namespace

std::vector<Column> parse_columns(const std::string& words, const Scene& scene,
                                  const std::vector<std::string>& contacts) {
  std::vector<Column> columns;
  std::set<std::string> seen;
  const auto add = [&](const Column& column) {
    if (!seen.insert(column.name).second)
      throw Error("--columns", fmt::format("{} is given twice", column.name), "give each column once");
    columns.push_back(column);
  };
  for (const std::string& word : split_list(words)) {
    const auto kind = std::find_if(kinds.begin(), kinds.end(), [&](const auto& known) { return known.first == word; });
    if (kind != kinds.end()) {
      for (Index i = 0; i < count(scene, kind->second); ++i) add({kind->second, i, name_of(scene, kind->second, i)});
    } else if (const auto column = find_column(scene, word)) {
      add(*column);
    } else if (const auto found = contact_columns_of(word, contacts); !found.empty()) {
      for (const Column& one : found) add(one);
    } else {
      const auto known = known_words(scene, contacts);
      throw Error("--columns", fmt::format("found '{}'", word) + suggestion(word, known),
                  fmt::format("give {}, or single columns such as y0,w0,x0, separated by commas", join(known)));
    }
  }
  return columns;
}

std::vector<Column> default_columns(const Scene& scene, const std::vector<Index>& states,
                                    const std::vector<std::string>& contacts) {
  std::vector<Column> columns;
  for (Index i = 0; i < scene.constraints(); ++i)
    columns.push_back({ColumnKind::y, i, name_of(scene, ColumnKind::y, i)});
  for (const Index i : states) columns.push_back({ColumnKind::x, i, name_of(scene, ColumnKind::x, i)});
  for (Index k = 0; k < count(scene, ColumnKind::mode); ++k)
    columns.push_back({ColumnKind::mode, k, name_of(scene, ColumnKind::mode, k)});
  for (const Column& column : contact_columns_of("contact", contacts)) columns.push_back(column);
  return columns;
}

std::vector<Index> states_of(const std::vector<Column>& columns) {
  std::vector<Index> states;
  for (const Column& column : columns)
    if (column.kind == ColumnKind::x) states.push_back(column.component);
  std::sort(states.begin(), states.end());
  return states;
}

bool has_contacts(const std::vector<Column>& columns) {
  return std::any_of(columns.begin(), columns.end(), [](const Column& c) { return c.kind == ColumnKind::contact; });
}

bool need_trace(const std::vector<Column>& columns) {
  return std::any_of(columns.begin(), columns.end(), [](const Column& column) {
    return column.kind == ColumnKind::w || column.kind == ColumnKind::trace;
  });
}

}  // namespace bromwich::app
