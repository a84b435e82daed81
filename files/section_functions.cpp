// Functions of time in a section: expressions, tables, and the times at which they switch.

#include "core/base/error.hpp"
#include "files/names.hpp"
#include "files/section.hpp"

#include <fmt/format.h>

#include <set>

namespace bromwich {

namespace {

constexpr const char* function_remedy = "give a list of expressions of t, or the name of a file .csv";

}  // namespace

std::string Section::time_expression(const toml::node& node, const std::string& key) const {
  const auto* text = node.as_string();
  if (!text) return fmt::format("({})", number(node, key));
  return document_->expressions.kept().get(
      "in full " + text->get(), {}, [&] { return document_->expressions.in_full(text->get(), where(node, key)); });
}

std::string Section::expression(const std::string& key) const { return time_expression(require(key), key); }

const std::vector<std::string>& Section::texts_in_time(const std::string& key, Index size) const {
  return kept("the texts " + key, {double(size)}, [&] {
    std::vector<std::string> texts;
    if (size > 0 && require(key).is_number())
      return std::vector<std::string>(std::size_t(size), time_expression(require(key), key));
    if (size > 0 && single_text(key)) {
      for (Index i = 0; i < size; ++i) texts.push_back(document_->expressions.in_full(of_entry(key, i), where(key)));
      return texts;
    }
    for (const toml::node& entry : require_list(key, function_remedy))
      texts.push_back(is_table(entry) ? "0" : time_expression(entry, key));
    return texts;
  });
}

const TimeFunction& Section::function_of_texts(const std::string& key, Index size) const {
  return kept("the function " + key, {double(size)},
              [&] { return document_->expressions.in_time(texts_in_time(key, size)); });
}

/// As of_entry, with the numbers i of its own variables.
std::string Section::of_entry_and_own(const std::string& key, Index i, const std::string& own) const {
  return with_names_replaced(of_entry(key, i), [&](const std::string& name, std::string& by) {
    if (name.size() != 1 || own.find(name) == std::string::npos || document_->expressions.has(name)) return false;
    by = name + std::to_string(i);
    return true;
  });
}

std::vector<Formula> Section::formulas(const std::string& key, Index size,
                                       const std::map<std::string, std::size_t>& variables,
                                       const std::string& own) const {
  std::vector<Formula> found;
  if (single_text(key)) {
    for (Index i = 0; i < size; ++i)
      found.push_back(document_->expressions.formula(of_entry_and_own(key, i, own), variables, where(key)));
    return found;
  }
  const toml::array& list = require_list(key, "give a list of expressions, or one for all entries");
  for (const toml::node& entry : list) {
    const auto* text = entry.as_string();
    const std::string expression = text ? text->get() : fmt::format("{}", number(entry, key));
    found.push_back(document_->expressions.formula(expression, variables, where(entry, key)));
  }
  if (Index(found.size()) != size)
    throw Error(where(key), fmt::format("has {} entries", found.size()), fmt::format("give {}", size));
  return found;
}

FunctionValue Section::expressions(const std::string& key, Index size) const {
  if (!has(key)) return {};
  if (const toml::array* list = require(key).as_array())
    for (const toml::node& entry : *list)
      if (is_table(entry)) throw Error(where(entry, key), "found " + kind(entry), "give an expression of t");
  return {function_of_texts(key, size), Index(texts_in_time(key, size).size())};
}

FunctionValue Section::function(const std::string& key, double last_time, Index size) const {
  if (!has(key)) return {};
  const auto named = file(key);
  if (named && extension_of(named->name) == ".csv") return tabulated(key, *named, last_time);
  const SwitchTimes& switches = kept("the switch times of " + key, {double(size), last_time},
                                     [&] { return switch_times_of_texts(key, last_time, size); });
  const TimeFunction& of_texts = function_of_texts(key, size);
  const bool constant = size > 0 && require(key).is_number();
  return with_tables(
      key, last_time,
      {constant ? TimeFunction(LinearSource{of_texts}) : of_texts, Index(texts_in_time(key, size).size()), switches});
}

/// Entries of the list that name a table of one column each: they replace those of the texts.
FunctionValue Section::with_tables(const std::string& key, double last_time, FunctionValue of_texts) const {
  std::vector<std::pair<Index, TimeFunction>> tables;
  const toml::array* list = require(key).as_array();
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const toml::node& entry = (*list)[i];
    if (!is_table(entry)) continue;
    const NumberFile named = *file(entry);
    const TimeTable& table = kept("the table of entry " + std::to_string(i) + " of " + key, {}, [&] {
      return read_time_table(read_text(named, where(entry, key)), named.name, key.front());
    });
    if (table.values.cols() != 1)
      throw Error(where(entry, key), fmt::format("the table '{}' has {} columns", named.name, table.values.cols()),
                  fmt::format("give one, t,{}0, for one entry", key.front()));
    require_times_until(table, last_time);
    of_texts.switches = together({{of_texts.switches, 0}, {{kinks(table, last_time), true}, 0}});
    tables.emplace_back(Index(i), interpolate(table));
  }
  if (tables.empty()) return of_texts;
  of_texts.function = [texts = of_texts.function, tables](double t, Eigen::Ref<Vector> value) {
    texts(t, value);
    for (const auto& [i, table] : tables) table(t, value.segment(i, 1));
  };
  return of_texts;
}

SwitchTimes Section::switch_times_of_texts(const std::string& key, double last_time, Index size) const {
  const Expressions& expressions = document_->expressions;
  if (size > 0 && require(key).is_number()) return {{}, true};
  if (size > 0 && single_text(key)) return expressions.switch_times(texts_in_time(key, size), last_time);
  std::vector<SwitchSearch> all;
  std::set<std::string> seen;
  for (const toml::node& entry : require_list(key, function_remedy))
    if (const auto* text = entry.as_string(); text && !is_table(entry) && seen.insert(text->get()).second)
      all.push_back(expressions.kept().get("the switch times of " + text->get(), {last_time}, [&] {
        return expressions.switch_search(time_expression(entry, key), last_time);
      }));
  return together(all);
}

FunctionValue Section::tabulated(const std::string& key, const NumberFile& named, double last_time) const {
  const TimeTable& table = kept("the table " + key, {},
                                [&] { return read_time_table(read_text(named, where(key)), named.name, key.front()); });
  require_times_until(table, last_time);
  const auto& kinks_of_table = kept("the kinks of " + key, {last_time}, [&] { return kinks(table, last_time); });
  const TimeFunction& function = kept("the function " + key, {}, [&] { return interpolate(table); });
  return {function, table.values.cols(), {kinks_of_table, true}};
}

}  // namespace bromwich
