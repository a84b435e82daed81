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

namespace bromwich {

namespace {

constexpr const char* list_remedy = "give a list such as [1, \"2*R\"] or the name of a file .csv or .mtx";
constexpr const char* rows_remedy =
    "give rows of numbers and expressions such as [[1, \"-1/C\"], [0, 1]], the name of a file .mtx or .csv, or "
    "identity(n), zero(rows, columns) or tridiag(n, lower, diagonal, upper) in quotes";

}  // namespace

std::string extension_of(const std::string& name) {
  std::string found = std::filesystem::path(name).extension();
  std::transform(found.begin(), found.end(), found.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return found;
}

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

bool Section::flag(const std::string& key) const {
  const toml::node* node = find(key);
  if (!node) return false;
  const auto* flag = node->as_boolean();
  if (!flag) throw Error(where(key), "found " + kind(*node), "give true or false, without quotes");
  return flag->get();
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
  if (const std::string found = extension_of(name); found != ".mtx" && found != ".csv") return std::nullopt;
  const std::string& in = node.source().path ? *node.source().path : document_->name;
  const std::filesystem::path path = document_->folders.at(in) / name;
  if (std::find(document_->read.begin(), document_->read.end(), path) == document_->read.end())
    document_->read.push_back(path);
  return NumberFile{path.string(), path};
}

/// An entry of a list of functions that names a table.
bool Section::is_table(const toml::node& node) const {
  const auto* text = node.as_string();
  return text && extension_of(text->get()) == ".csv";
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
  if (size > 0 && require(key).is_number()) return Vector::Constant(size, number(key));
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

Matrix Section::row_or_rows(const std::string& key, Index columns) const {
  const toml::array* list = require(key).as_array();
  const bool rows = list && !list->empty() && (*list)[0].is_array();
  return rows ? inline_matrix(key) : Matrix(vector(key, columns).transpose());
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

std::vector<std::string> Section::one_or_more_texts(const std::string& key) const {
  constexpr const char* remedy = "give a text in quotes, or a list of them";
  if (const std::string* one = single_text(key)) return {*one};
  std::vector<std::string> found;
  for (const toml::node& entry : require_list(key, remedy)) {
    const auto* text = entry.as_string();
    if (!text) throw Error(where(entry, key), "found " + kind(entry), remedy);
    found.push_back(text->get());
  }
  if (found.empty()) throw Error(where(key), "is empty", remedy);
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

bool Section::has_rows(const std::string& key) const {
  return has(key) && (require(key).is_array() || file(key).has_value());
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
  if (extension_of(named->name) == ".csv") return read_number_table(text, named->name);
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

}  // namespace bromwich
