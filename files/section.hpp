#pragma once
// One section of a scene file: typed values by key, with errors that name file, line and key.

#include "core/base/time_function.hpp"
#include "files/expression.hpp"
#include "files/number_files.hpp"

#include <toml++/toml.h>

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace bromwich {

/// Data shared by all sections of a file.
struct Document {
  std::string name;  ///< of the file in messages
  Expressions expressions = {};
  mutable std::vector<std::filesystem::path> read = {};       ///< tables, matrices and included files
  std::map<std::string, std::filesystem::path> folders = {};  ///< of this file and of included ones, by name
  /// Keys of [parameters] and [definitions] in the order of the files, those of included files first.
  std::map<std::string, std::vector<std::string>> order = {};
};

/// A function of time and its number of values; an empty function is zero.
struct FunctionValue {
  TimeFunction function;
  Index entries = 0;
  SwitchTimes switches = {};  ///< times at which it may jump or have a kink
};

class Section {
 public:
  /// `table` is null if the file has no such section. `keys` are the allowed ones: Error for any other.
  Section(const Document& document, const toml::table* table, std::string name, const std::vector<std::string>& keys);

  bool given() const { return table_ != nullptr; }
  /// make(), which reads keys of the file, as KeptValues::get keeps it. `what`: of this section.
  template <class Make>
  const auto& kept(const std::string& what, const std::vector<double>& given, const Make& make) const {
    return document_->expressions.kept().get(name_ + "." + what, given, make);
  }
  bool has(const std::string& key) const { return find(key) != nullptr; }
  /// "rlcd.toml:7: dynamics.A"; if the key is missing, the line of the section.
  std::string where(const std::string& key) const;

  double number(const std::string& key) const;
  std::optional<double> optional_number(const std::string& key) const;
  Index positive_integer(const std::string& key, Index otherwise) const;
  std::string text(const std::string& key, const std::string& otherwise) const;
  bool flag(const std::string& key) const;  ///< false if the key is missing
  /// One of `words`; the first if the key is missing.
  std::string word(const std::string& key, const std::vector<std::string>& words) const;

  /// A list or a file; with `size` also one expression for all entries i = 0, ..., size - 1. In lines of `line` entries
  /// i counts the lines and j the entries of a line.
  Vector vector(const std::string& key, Index size = 0, Index line = 1) const;
  /// A list of `columns` numbers as one row, or rows of them.
  Matrix row_or_rows(const std::string& key, Index columns) const;
  /// One number for all, or `count` of them.
  Vector one_or_each(const std::string& key, Index count) const;
  /// Two of `words`, numbers or expressions, or one for both; the first word if the key is missing.
  std::array<std::variant<std::string, double>, 2> two_words_or_numbers(const std::string& key,
                                                                        const std::vector<std::string>& words) const;
  /// Unknown entries, "" or nan, are NaN; empty if the key is missing.
  std::vector<double> partly_known(const std::string& key) const;
  /// Texts, or one for all of `size` entries; empty if the key is missing.
  std::vector<std::string> texts(const std::string& key, Index size) const;
  /// `rows` and `columns`: the size of "identity" and "zero", if it is known; of a square one a number is that multiple
  /// of the identity. It stays as KeptValues says.
  const MatrixValue& matrix(const std::string& key, Index rows = 0, Index columns = 0) const;
  bool has_rows(const std::string& key) const;  ///< the key is there, and its matrix is a list of rows or a file
  /// Expressions of t, or a table of values up to `last_time`; with `size` also one expression for all entries i, and a
  /// number for a single one.
  FunctionValue function(const std::string& key, double last_time, Index size = 0) const;
  /// Expressions of t; empty if the key is missing.
  FunctionValue expressions(const std::string& key, Index size = 0) const;
  /// Expressions of t and of variables as programs, of `size` entries; or one for all entries i, in which the letters
  /// of `own` stand for their i-th numbers.
  std::vector<Formula> formulas(const std::string& key, Index size, const std::map<std::string, std::size_t>& variables,
                                const std::string& own) const;
  /// The text of an expression of t.
  std::string expression(const std::string& key) const;
  /// One text or a list of them.
  std::vector<std::string> one_or_more_texts(const std::string& key) const;

  /// The keys of the section, in the order of the file.
  std::vector<std::string> keys() const;
  /// What follows the last point of the name of the section.
  std::string last_name() const { return name_.substr(name_.rfind('.') + 1); }
  /// A table by key, with these keys.
  Section table(const std::string& key, const std::vector<std::string>& keys) const;
  /// The tables of a list, or those of a table in the order of the file.
  std::vector<Section> tables(const std::string& key, const std::vector<std::string>& keys) const;
  const Expressions& expressions_of_file() const { return document_->expressions; }

 private:
  const toml::node* find(const std::string& key) const;
  const toml::node& require(const std::string& key) const;
  const toml::array& require_list(const std::string& key, const std::string& remedy) const;
  std::string place(const toml::source_region& source) const;
  std::string where(const toml::node& node, const std::string& key) const;
  double number(const toml::node& node, const std::string& key) const;
  std::variant<std::string, double> word_or_number(const toml::node& node, const std::string& key,
                                                   const std::vector<std::string>& words) const;
  Vector read_vector(const std::string& key, Index size, Index line) const;
  MatrixValue read_matrix(const std::string& key, Index rows, Index columns) const;
  const std::vector<std::string>& texts_in_time(const std::string& key, Index size) const;
  const TimeFunction& function_of_texts(const std::string& key, Index size) const;
  SwitchTimes switch_times_of_texts(const std::string& key, double last_time, Index size) const;
  FunctionValue with_tables(const std::string& key, double last_time, FunctionValue of_texts) const;
  FunctionValue tabulated(const std::string& key, const NumberFile& table, double last_time) const;
  std::string of_entry(const std::string& key, Index i, std::optional<Index> j = {}) const;
  std::string of_entry_and_own(const std::string& key, Index i, const std::string& own) const;
  const std::string* single_text(const std::string& key) const;
  std::string time_expression(const toml::node& node, const std::string& key) const;
  Matrix inline_matrix(const std::string& key) const;
  std::optional<NumberFile> file(const std::string& key) const { return file(require(key)); }
  std::optional<NumberFile> file(const toml::node& node) const;
  bool is_table(const toml::node& node) const;

  const Document* document_;
  const toml::table* table_;
  std::string name_;
};

/// "a number", "a list", ...
std::string kind(const toml::node& node);
/// ".csv" of "Table.CSV".
std::string extension_of(const std::string& name);
/// Of an integer, however large, or a number with a point; NaN of other nodes.
double value_of(const toml::node& node);

}  // namespace bromwich
