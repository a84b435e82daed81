#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

/// The lines of a text one by one, with their numbers for messages.
class LineReader {
 public:
  LineReader(std::string_view text, std::string name) : text_(text), name_(std::move(name)) {}

  /// Moves to the next line; false at the end.
  bool next();
  std::string_view line() const { return line_; }  ///< without the end-of-line characters
  bool blank() const;

  /// The line split at blanks.
  std::vector<std::string_view> words() const;
  /// The line split at commas, without blanks around the pieces.
  std::vector<std::string_view> cells() const;
  /// A finite number; throws Error naming file and line.
  double number(std::string_view word) const;

  std::string place() const;  ///< "table.csv:7"
  std::size_t bytes() const { return text_.size(); }

 private:
  std::string_view text_, line_;
  std::string name_;
  std::size_t begin_ = 0;
  std::size_t number_ = 0;
};

}  // namespace bromwich
