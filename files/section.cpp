#include "files/section.hpp"

#include "core/base/error.hpp"
#include "files/matrix_forms.hpp"
#include "files/names.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <set>

namespace bromwich {

namespace {

constexpr const char* list_remedy = "give a list such as [1, \"2*R\"] or the name of a file .csv or .mtx";
constexpr const char* rows_remedy =
    "give rows of numbers and expressions such as [[1, \"-1/C\"], [0, 1]], the name of a file .mtx or .csv, or "
    "identity(n), zero(rows, columns) or tridiag(n, lower, diagonal, upper) in quotes";
constexpr const char* function_remedy = "give a list of expressions of t, or the name of a file .csv";

std::string extension(const std::string& name) {
  std::string found = std::filesystem::path(name).extension();
  std::transform(found.begin(), found.end(), found.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return found;
}

}  // namespace

std::string kind(const toml::node& node) {
  if (node.is_table()) return "a table";
  if (node.is_array()) return "a list";
  if (const auto* text = node.as_string()) return fmt::format("the text '{}'", one_line(text->get()));
  if (const auto* flag = node.as_boolean()) return flag->get() ? "true" : "false";
  if (const auto* value = node.as_floating_point()) return fmt::format("{}", value->get());
  if (const auto* value = node.as_integer()) return fmt::format("{}", value->get());
  return "a date or time";
}

Section::Section(const Document& document, const toml::table* table, std::string name,
                 const std::vector<std::string>& keys)
    : document_(&document), table_(table), name_(std::move(name)) {
  if (!table_) return;
  for (const auto& [key, node] : *table_) {
    const std::string found(key.str());
    if (std::find(keys.begin(), keys.end(), found) != keys.end()) continue;
    const std::string what = name_.empty() && node.is_table() ? "section" : "key";
    throw Error(
        fmt::format("{}: {}", place(key.source()), name_.empty() ? one_line(found) : name_ + "." + one_line(found)),
        fmt::format("is no known {}{}", what, suggestion(found, keys)),
        found == "include" ? "move it to the head of the file, above all sections" : "use one of " + join(keys));
  }
}

std::string Section::place(const toml::source_region& source) const {
  return fmt::format("{}:{}", source.path ? *source.path : document_->name,
                     std::max<std::uint32_t>(source.begin.line, 1));
}

double value_of(const toml::node& node) {
  if (const auto* whole = node.as_integer()) return double(whole->get());
  const auto* value = node.as_floating_point();
  return value ? value->get() : NAN;
}

const toml::node* Section::find(const std::string& key) const { return table_ ? table_->get(key) : nullptr; }

std::string Section::where(const toml::node& node, const std::string& key) const {
  return fmt::format("{}: {}", place(node.source()), name_.empty() ? key : name_ + "." + key);
}

std::string Section::where(const std::string& key) const {
  if (const toml::node* node = find(key)) return where(*node, key);
  if (table_) return where(*table_, key);
  return fmt::format("{}:1: {}.{}", document_->name, name_, key);
}

const toml::node& Section::require(const std::string& key) const {
  const toml::node* node = find(key);
  if (!node) throw Error(where(key), "is missing", fmt::format("add {} = ... to [{}]", key, name_));
  return *node;
}

const toml::array& Section::require_list(const std::string& key, const std::string& remedy) const {
  const toml::node& node = require(key);
  if (!node.is_array()) throw Error(where(key), "found " + kind(node), remedy);
  return *node.as_array();
}

double Section::number(const toml::node& node, const std::string& key) const {
  if (const auto* text = node.as_string())
    return document_->expressions.kept().get(
        "the number " + text->get(), {}, [&] { return document_->expressions.number(text->get(), where(node, key)); });
  const double value = value_of(node);
  if (!std::isfinite(value))
    throw Error(where(node, key), "found " + kind(node), "give a finite number, or an expression in quotes");
  return value;
}

double Section::number(const std::string& key) const { return number(require(key), key); }

std::optional<double> Section::optional_number(const std::string& key) const {
  return has(key) ? std::optional(number(key)) : std::nullopt;
}

Index Section::positive_integer(const std::string& key, Index otherwise) const {
  if (!has(key)) return otherwise;
  constexpr double largest = 1 << 24;
  const double value = number(key);
  if (value != std::floor(value) || value < 1 || value > largest)
    throw Error(where(key), fmt::format("found {}", value), fmt::format("give a whole number from 1 to {}", largest));
  return Index(value);
}

std::string Section::text(const std::string& key, const std::string& otherwise) const {
  const toml::node* node = find(key);
  if (!node) return otherwise;
  const auto* text = node->as_string();
  if (!text) throw Error(where(key), "found " + kind(*node), "give a text in quotes");
  return one_line(text->get());
}

std::string Section::word(const std::string& key, const std::vector<std::string>& words) const {
  const std::string found = text(key, words.front());
  if (std::find(words.begin(), words.end(), found) == words.end())
    throw Error(where(key), fmt::format("found '{}'", found) + suggestion(found, words), "use one of " + join(words));
  return found;
}

std::optional<NumberFile> Section::file(const toml::node& node) const {
  const auto* text = node.as_string();
  if (!text) return std::nullopt;
  const std::string& name = text->get();
  if (const std::string found = extension(name); found != ".mtx" && found != ".csv") return std::nullopt;
  const std::string& in = node.source().path ? *node.source().path : document_->name;
  const std::filesystem::path path = document_->folders.at(in) / name;
  if (std::find(document_->read.begin(), document_->read.end(), path) == document_->read.end())
    document_->read.push_back(path);
  return NumberFile{path.string(), path};
}

/// An entry of a list of functions that names a table.
bool Section::is_table(const toml::node& node) const {
  const auto* text = node.as_string();
  return text && extension(text->get()) == ".csv";
}

const std::string* Section::single_text(const std::string& key) const {
  const toml::value<std::string>* text = require(key).as_string();
  return text ? &text->get() : nullptr;
}

/// The one expression of all entries, for entry i; parameters of this name have priority.
std::string Section::of_entry(const std::string& key, Index i, std::optional<Index> j) const {
  return with_names_replaced(*single_text(key), [&](const std::string& name, std::string& by) {
    const bool index = name == "i" || (name == "j" && j);
    if (!index || document_->expressions.has(name)) return false;
    by = std::to_string(name == "i" ? i : *j);
    return true;
  });
}

Vector Section::vector(const std::string& key, Index size, Index line) const {
  return kept("the vector " + key, {double(size), double(line)}, [&] { return read_vector(key, size, line); });
}

Vector Section::read_vector(const std::string& key, Index size, Index line) const {
  if (size > 0 && !file(key) && single_text(key)) {
    Vector values(size);
    for (Index k = 0; k < size; ++k)
      values[k] =
          document_->expressions.number(line > 1 ? of_entry(key, k / line, k % line) : of_entry(key, k), where(key));
    return values;
  }
  if (file(key)) {
    const MatrixValue& value = matrix(key);
    if (rows(value) != 1 && columns(value) != 1)
      throw Error(where(key), fmt::format("the file holds a matrix of {} x {}", rows(value), columns(value)),
                  "give a single row or column");
    const Matrix dense = std::visit([](const auto& found) { return Matrix(found); }, value);
    return dense.reshaped();
  }
  const toml::array& list = require_list(key, list_remedy);
  Vector values(Index(list.size()));
  for (std::size_t i = 0; i < list.size(); ++i) values[Index(i)] = number(list[i], key);
  return values;
}

Vector Section::one_or_each(const std::string& key, Index count) const {
  if (!require(key).is_array()) return Vector::Constant(count, number(key));
  const Vector each = vector(key);
  if (each.size() != count)
    throw Error(where(key), fmt::format("has {} entries", each.size()),
                count == 2 ? "give one number or two" : fmt::format("give one number or {}", count));
  return each;
}

std::variant<std::string, double> Section::word_or_number(const toml::node& node, const std::string& key,
                                                          const std::vector<std::string>& words) const {
  const auto* text = node.as_string();
  if (!text) return number(node, key);
  if (std::find(words.begin(), words.end(), text->get()) != words.end()) return text->get();
  if (const std::string near = suggestion(text->get(), words); !near.empty())
    throw Error(where(node, key), "found " + kind(node) + near, "use " + join(words) + ", or a number");
  return number(node, key);
}

std::array<std::variant<std::string, double>, 2> Section::two_words_or_numbers(
    const std::string& key, const std::vector<std::string>& words) const {
  if (!has(key)) return {words.front(), words.front()};
  const toml::array* list = require(key).as_array();
  if (!list) {
    const auto both = word_or_number(require(key), key, words);
    return {both, both};
  }
  if (list->size() != 2)
    throw Error(where(key), fmt::format("has {} entries", list->size()),
                "give one for both ends, or two, of " + join(words) + " and numbers");
  return {word_or_number((*list)[0], key, words), word_or_number((*list)[1], key, words)};
}

std::vector<std::string> Section::texts(const std::string& key, Index size) const {
  if (!has(key)) return {};
  const std::string remedy = fmt::format("give a list of {} texts in quotes", size);
  if (const std::string* one = single_text(key)) return std::vector<std::string>(std::size_t(size), one_line(*one));
  std::vector<std::string> found;
  for (const toml::node& entry : require_list(key, remedy)) {
    const auto* text = entry.as_string();
    if (!text) throw Error(where(entry, key), "found " + kind(entry), remedy);
    found.push_back(one_line(text->get()));
  }
  if (Index(found.size()) != size)
    throw Error(where(key), fmt::format("has {} entries", found.size()), fmt::format("give {}", size));
  return found;
}

std::vector<double> Section::partly_known(const std::string& key) const {
  std::vector<double> values;
  if (!has(key)) return values;
  for (const toml::node& entry : require_list(key, "give a list; nan or \"\" stand for unknown entries")) {
    const auto* text = entry.as_string();
    const auto* value = entry.as_floating_point();
    const bool unknown =
        text ? text->get().empty() || text->get() == "nan" : value != nullptr && std::isnan(value->get());
    values.push_back(unknown ? std::numeric_limits<double>::quiet_NaN() : number(entry, key));
  }
  return values;
}

const MatrixValue& Section::matrix(const std::string& key, Index rows, Index columns) const {
  return kept("the matrix " + key, {double(rows), double(columns)}, [&] { return read_matrix(key, rows, columns); });
}

namespace {

SparseMatrix multiple_of_identity(Index size, double value) {
  SparseMatrix matrix(size, size);
  matrix.setIdentity();
  return (value * matrix).pruned();
}

/// Whether all names of the text are those of functions and of the file.
bool has_meaning(const std::string& text, const Expressions& expressions) {
  static const auto functions = expression_functions();
  const auto names = names_in(text);
  return !one_line(text).empty() && std::all_of(names.begin(), names.end(), [&](const Name& name) {
    if (name.called) return std::find(functions.begin(), functions.end(), name.text) != functions.end();
    return name.text == "pi" || expressions.has(name.text);
  });
}

}  // namespace

MatrixValue Section::read_matrix(const std::string& key, Index rows, Index columns) const {
  const auto named = file(key);
  if (!named) {
    const std::string* word = single_text(key);
    const bool square = rows == columns && rows > 0;
    if (!word && square && require(key).is_number()) return multiple_of_identity(rows, this->number(key));
    if (!word) return inline_matrix(key);
    const auto number = [&](const std::string& text) { return document_->expressions.number(text, where(key)); };
    if (const auto form = matrix_form(*word, rows, columns, number, where(key))) return *form;
    if (square && has_meaning(*word, document_->expressions)) return multiple_of_identity(rows, number(*word));
    throw Error(where(key),
                "found " + kind(require(key)) + suggestion(word->substr(0, word->find('(')), matrix_forms()),
                rows_remedy);
  }
  const std::string text = read_text(*named, where(key));
  if (extension(named->name) == ".csv") return read_number_table(text, named->name);
  return read_matrix_market(text, named->name);
}

Matrix Section::inline_matrix(const std::string& key) const {
  const toml::array& list = require_list(key, rows_remedy);
  Matrix values;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const toml::array* row = list[i].as_array();
    if (!row) throw Error(where(list[i], key), fmt::format("row {} is {}", i, kind(list[i])), rows_remedy);
    if (i == 0) values.resize(Index(list.size()), Index(row->size()));
    if (Index(row->size()) != values.cols())
      throw Error(where(list[i], key),
                  fmt::format("row 0 has {} entries and row {} has {}", values.cols(), i, row->size()),
                  "give rows of equal length");
    for (std::size_t j = 0; j < row->size(); ++j) values(Index(i), Index(j)) = number((*row)[j], key);
  }
  return values;
}

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
  if (named && extension(named->name) == ".csv") return tabulated(key, *named, last_time);
  const SwitchTimes& switches = kept("the switch times of " + key, {double(size), last_time},
                                     [&] { return switch_times_of_texts(key, last_time, size); });
  return with_tables(key, last_time, {function_of_texts(key, size), Index(texts_in_time(key, size).size()), switches});
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
