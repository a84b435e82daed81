#include "files/line_reader.hpp"

#include "core/base/error.hpp"
#include "files/words.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr std::string_view blanks = " \t\r";

std::string_view trimmed(std::string_view piece) {
  const std::size_t first = piece.find_first_not_of(blanks);
  return first == std::string_view::npos ? std::string_view{}
                                         : piece.substr(first, piece.find_last_not_of(blanks) - first + 1);
}

}  // namespace

bool LineReader::next() {
  if (begin_ >= text_.size()) return false;
  const std::size_t end = std::min(text_.find('\n', begin_), text_.size());
  line_ = trimmed(text_.substr(begin_, end - begin_));
  begin_ = end + 1;
  ++number_;
  return true;
}

bool LineReader::blank() const { return line_.empty(); }

std::vector<std::string_view> LineReader::words() const {
  std::vector<std::string_view> words;
  for (std::size_t begin = line_.find_first_not_of(blanks); begin != std::string_view::npos;) {
    const std::size_t end = std::min(line_.find_first_of(blanks, begin), line_.size());
    words.push_back(line_.substr(begin, end - begin));
    begin = line_.find_first_not_of(blanks, end);
  }
  return words;
}

std::vector<std::string_view> LineReader::cells() const {
  std::vector<std::string_view> cells;
  for (std::size_t begin = 0; begin <= line_.size();) {
    const std::size_t end = std::min(line_.find(',', begin), line_.size());
    cells.push_back(trimmed(line_.substr(begin, end - begin)));
    begin = end + 1;
  }
  return cells;
}

double LineReader::number(std::string_view word) const {
  const auto value = parse_double(word);
  if (!value) throw Error(place(), "'" + one_line(word) + "' is no finite number", "write a number such as -1.5e-3");
  return *value;
}

std::string LineReader::place() const { return name_ + ":" + std::to_string(std::max<std::size_t>(number_, 1)); }

}  // namespace bromwich
