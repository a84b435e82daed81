#include "core/base/error.hpp"
#include "files/line_reader.hpp"
#include "files/number_files.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <memory>

namespace bromwich {

namespace {

/// Times may be written with fewer digits than T has, for example T = 3 pi.
constexpr double rounding = 1e-9;

bool next_row(LineReader& lines) {
  while (lines.next())
    if (!lines.blank() && lines.line()[0] != '#') return true;
  return false;
}

/// Appends the numbers of the line, which must have `columns` of them; 0 = any number.
void append_row(const LineReader& lines, std::size_t columns, std::vector<double>& values) {
  const auto cells = lines.cells();
  if (columns > 0 && cells.size() != columns)
    throw Error(lines.place(), fmt::format("found {} values where the lines before have {}", cells.size(), columns),
                "give rows of equal length");
  for (const std::string_view cell : cells) values.push_back(lines.number(cell));
}

RowMatrix as_matrix(const std::vector<double>& values, std::size_t columns) {
  const Index width = Index(columns);
  return Eigen::Map<const RowMatrix>(values.data(), Index(values.size()) / width, width);
}

/// Reads the header `t,f0,f1,...` and returns the number of entries.
std::size_t read_header(LineReader& lines, char letter) {
  const std::string form = fmt::format("begin with a line t,{0}0,{0}1,... that has one column per entry", letter);
  const bool some = next_row(lines);
  const auto cells = some ? lines.cells() : std::vector<std::string_view>{};
  if (cells.size() < 2 || cells[0] != "t") throw Error(lines.place(), "found no header", form);
  for (std::size_t i = 1; i < cells.size(); ++i) {
    const std::string expected = fmt::format("{}{}", letter, i - 1);
    if (cells[i] != expected)
      throw Error(lines.place(), fmt::format("column {} is '{}', not {}", i, one_line(cells[i]), expected), form);
  }
  return cells.size() - 1;
}

struct Descriptor {
  explicit Descriptor(int opened) : number(opened) {}
  ~Descriptor() {
    if (number >= 0) ::close(number);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int number;
};

}  // namespace

std::string read_text(const NumberFile& file, const std::string& where) {
  const auto refused = [&](const char* form, const char* remedy) {
    return Error(where, fmt::format(fmt::runtime(form), one_line(file.name)), remedy);
  };
  // Non-blocking: the other end of a pipe may never be opened.
  const Descriptor opened(::open(file.path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  struct stat found {};
  if (opened.number < 0 && (errno == ENOENT || errno == ENOTDIR))
    throw refused("the file '{}' does not exist", "name a file by its path, in scene files from their folder");
  if (opened.number < 0 && errno == ENAMETOOLONG)
    throw refused("the name '{}' is too long for a file", "name a file by its path, in scene files from their folder");
  if (opened.number < 0 || ::fstat(opened.number, &found) != 0)
    throw refused("the file '{}' cannot be read", "check its permissions");
  if (S_ISDIR(found.st_mode)) throw refused("'{}' is a folder", "name a file");
  if (!S_ISREG(found.st_mode)) throw refused("'{}' is no regular file", "copy what it delivers into a file first");
  std::string text;
  std::vector<char> block(1 << 16);
  for (;;) {
    const ssize_t count = ::read(opened.number, block.data(), block.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw refused("the file '{}' cannot be read", "check its permissions");
    if (count == 0) break;
    text.append(block.data(), std::size_t(count));
  }
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);  // the mark of UTF-8
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF"))
    throw refused("the file '{}' is in UTF-16", "save it as UTF-8");
  return text;
}

Matrix read_number_table(const std::string& text, const std::string& name) {
  LineReader lines(text, name);
  std::vector<double> values;
  std::size_t columns = 0;
  while (next_row(lines)) {
    append_row(lines, columns, values);
    if (columns == 0) columns = values.size();
  }
  if (columns == 0) throw Error(lines.place(), "the file holds no numbers", "write one row per line");
  return as_matrix(values, columns);
}

TimeTable read_time_table(const std::string& text, const std::string& name, char letter) {
  LineReader lines(text, name);
  const std::size_t columns = read_header(lines, letter) + 1;
  std::vector<double> values;
  double previous = 0;
  bool twice = false;  // the two previous rows have the same time
  while (next_row(lines)) {
    append_row(lines, columns, values);
    const double t = values[values.size() - columns];
    if (values.size() == columns && t > 0)
      throw Error(lines.place(), fmt::format("the times begin at {}", t), "begin at t = 0 or before");
    if (values.size() > columns && t < previous)
      throw Error(lines.place(), fmt::format("the time {} follows {}", t, previous), "give ascending times");
    if (twice && t == previous)
      throw Error(lines.place(), fmt::format("the time {} is given three times", t),
                  "give the values before and behind a jump, two lines");
    twice = values.size() > columns && t == previous;
    previous = t;
  }
  if (values.empty()) throw Error(lines.place(), "the file holds no times", "give one line per time");
  const RowMatrix table = as_matrix(values, columns);
  return {table.col(0), table.rightCols(table.cols() - 1), lines.place()};
}

void require_times_until(const TimeTable& table, double last_time) {
  const double last = table.t[table.t.size() - 1];
  if (last < last_time - rounding * std::abs(last_time))
    throw Error(table.end, fmt::format("the times end at {}, before T = {}", last, last_time),
                "go on to T or shorten the time");
}

TimeFunction interpolate(TimeTable table) {
  const auto shared = std::make_shared<const TimeTable>(std::move(table));
  return [shared](double t, Eigen::Ref<Vector> value) {
    const Vector& times = shared->t;
    const double* after = std::upper_bound(times.data(), times.data() + times.size(), t);
    const Index right = Index(after - times.data());
    if (right == 0 || right == times.size()) {
      value = shared->values.row(right == 0 ? 0 : right - 1).transpose();
      return;
    }
    const double weight = (t - times[right - 1]) / (times[right] - times[right - 1]);
    value = (1 - weight) * shared->values.row(right - 1).transpose() + weight * shared->values.row(right).transpose();
  };
}

std::vector<double> kinks(const TimeTable& table, double last_time) {
  constexpr double rounded = 1e-12;  // of the values: with smaller differences a point lies on the line
  std::vector<double> found;
  const auto add = [&](double t) {
    if (t > 0 && t < last_time && (found.empty() || found.back() < t)) found.push_back(t);
  };
  const Index rows = table.t.size();
  const double largest = table.values.size() > 0 ? table.values.cwiseAbs().maxCoeff() : 0;
  for (Index j = 1; j + 1 < rows; ++j) {
    const double before = table.t[j] - table.t[j - 1], behind = table.t[j + 1] - table.t[j];
    if (before == 0) continue;  // handled with the previous row
    if (behind == 0) {
      add(table.t[j]);
      continue;
    }
    const double weight = behind / (before + behind);
    const Eigen::RowVectorXd line = weight * table.values.row(j - 1) + (1 - weight) * table.values.row(j + 1);
    if ((line - table.values.row(j)).cwiseAbs().maxCoeff() > rounded * largest) add(table.t[j]);
  }
  if (rows > 1 && table.t[rows - 1] < last_time - rounding * last_time) add(table.t[rows - 1]);
  return found;
}

Index rows(const MatrixValue& value) {
  return std::visit([](const auto& matrix) { return matrix.rows(); }, value);
}

Index columns(const MatrixValue& value) {
  return std::visit([](const auto& matrix) { return matrix.cols(); }, value);
}

}  // namespace bromwich
