// The Matrix Market exchange format (Boisvert, Pozo, Remington, NISTIR 5935).

#include "core/base/error.hpp"
#include "files/line_reader.hpp"
#include "files/number_files.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace bromwich {

namespace {

/// Limit of the sizes in a header: column starts of 80 MB.
constexpr long long largest_side = 10'000'000;

struct Header {
  bool coordinate = false, pattern = false;
  bool symmetric = false, skew = false;
};

/// One of `choices`, ignoring case.
std::string choice(const LineReader& lines, std::string word, const char* what,
                   const std::vector<std::string>& choices) {
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (std::find(choices.begin(), choices.end(), word) == choices.end())
    throw Error(lines.place(), fmt::format("the {} is '{}'", what, one_line(word)), "use one of " + join(choices));
  return word;
}

Header read_header(LineReader& lines) {
  const bool some = lines.next();
  const auto words = some ? lines.words() : std::vector<std::string_view>{};
  if (words.size() != 5 || words[0] != "%%MatrixMarket")
    throw Error(lines.place(), "the first line is no Matrix Market header",
                "begin with '%%MatrixMarket matrix coordinate real general'");
  choice(lines, std::string(words[1]), "object", {"matrix"});
  const std::string format = choice(lines, std::string(words[2]), "format", {"coordinate", "array"});
  const std::string field = choice(lines, std::string(words[3]), "field", {"real", "integer", "pattern"});
  const std::string symmetry =
      choice(lines, std::string(words[4]), "symmetry", {"general", "symmetric", "skew-symmetric"});
  const Header header{format == "coordinate", field == "pattern", symmetry == "symmetric",
                      symmetry == "skew-symmetric"};
  if (header.pattern && !header.coordinate)
    throw Error(lines.place(), "an array cannot be a pattern", "write real or integer");
  if (header.pattern && header.skew)
    throw Error(lines.place(), "a pattern cannot be skew-symmetric", "write general or symmetric");
  return header;
}

/// The next line with data.
bool next_data(LineReader& lines) {
  while (lines.next())
    if (!lines.blank() && lines.line()[0] != '%') return true;
  return false;
}

long long whole(const LineReader& lines, std::string_view word, const char* what, long long least, long long most) {
  const auto value = parse_integer(word);
  if (!value || *value < least || *value > most)
    throw Error(lines.place(), fmt::format("the {} is '{}'", what, one_line(word)),
                fmt::format("write a whole number from {} to {}", least, most));
  return *value;
}

struct Size {
  Index rows = 0, columns = 0;
  long long entries = 0;
};

Size read_size(LineReader& lines, const Header& header) {
  const std::size_t expected = header.coordinate ? 3 : 2;
  const char* form = header.coordinate ? "rows, columns and entries" : "rows and columns";
  if (!next_data(lines)) throw Error(lines.place(), "the file ends before its sizes", std::string("give ") + form);
  const auto words = lines.words();
  if (words.size() != expected)
    throw Error(lines.place(), fmt::format("found {} sizes", words.size()),
                fmt::format("give {} whole numbers: {}", expected, form));
  Size size;
  size.rows = Index(whole(lines, words[0], "number of rows", 1, largest_side));
  size.columns = Index(whole(lines, words[1], "number of columns", 1, largest_side));
  if (header.coordinate) size.entries = whole(lines, words[2], "number of entries", 0, largest_side * 100);
  if ((header.symmetric || header.skew) && size.rows != size.columns)
    throw Error(lines.place(), fmt::format("the matrix is {} x {}", size.rows, size.columns),
                "make a symmetric matrix square, or write general");
  return size;
}

void require_entry(LineReader& lines, long long read, long long announced) {
  if (!next_data(lines))
    throw Error(lines.place(), fmt::format("the file ends after {} of {} entries", read, announced),
                "add the missing ones or correct the sizes");
}

void require_end(LineReader& lines, long long announced) {
  if (next_data(lines))
    throw Error(lines.place(), fmt::format("found more than the {} entries announced", announced),
                "remove them or correct the sizes");
}

SparseMatrix read_coordinate(LineReader& lines, const Header& header, const Size& size) {
  std::vector<Eigen::Triplet<double>> entries;
  for (long long read = 0; read < size.entries; ++read) {
    require_entry(lines, read, size.entries);
    const auto words = lines.words();
    if (words.size() != (header.pattern ? 2u : 3u))
      throw Error(lines.place(), fmt::format("found {} words", words.size()),
                  header.pattern ? "write row and column" : "write row, column and value");
    const Index i = Index(whole(lines, words[0], "row", 1, size.rows) - 1);
    const Index j = Index(whole(lines, words[1], "column", 1, size.columns) - 1);
    const double value = header.pattern ? 1 : lines.number(words[2]);
    if ((header.symmetric && j > i) || (header.skew && j >= i))
      throw Error(lines.place(), fmt::format("entry ({}, {}) is not below the diagonal", i + 1, j + 1),
                  "give the lower triangle of a symmetric matrix, without the diagonal where it is skew-symmetric");
    entries.emplace_back(i, j, value);
    if (header.symmetric && i != j) entries.emplace_back(j, i, value);
    if (header.skew) entries.emplace_back(j, i, -value);
  }
  require_end(lines, size.entries);
  SparseMatrix matrix(size.rows, size.columns);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

/// Column by column; for a symmetric matrix only the lower triangle.
Matrix read_array(LineReader& lines, const Header& header, const Size& size) {
  const auto first_row = [&](Index j) { return header.skew ? j + 1 : header.symmetric ? j : 0; };
  long long announced = 0;
  for (Index j = 0; j < size.columns; ++j) announced += size.rows - std::min(first_row(j), size.rows);
  // Every entry takes at least two characters, so the size of the file limits the memory.
  if (announced > 1 + (long long)(lines.bytes() / 2))
    throw Error(lines.place(), fmt::format("the sizes announce {} entries, more than the file holds", announced),
                "correct the sizes");
  Matrix matrix = Matrix::Zero(size.rows, size.columns);
  long long read = 0;
  for (Index j = 0; j < size.columns; ++j)
    for (Index i = first_row(j); i < size.rows; ++i, ++read) {
      require_entry(lines, read, announced);
      const auto words = lines.words();
      if (words.size() != 1)
        throw Error(lines.place(), fmt::format("found {} words", words.size()), "write one number per line");
      matrix(i, j) = lines.number(words[0]);
      if (header.symmetric) matrix(j, i) = matrix(i, j);
      if (header.skew) matrix(j, i) = -matrix(i, j);
    }
  require_end(lines, announced);
  return matrix;
}

}  // namespace

MatrixValue read_matrix_market(const std::string& text, const std::string& name) {
  LineReader lines(text, name);
  const Header header = read_header(lines);
  const Size size = read_size(lines, header);
  if (header.coordinate) return read_coordinate(lines, header, size);
  return read_array(lines, header, size);
}

}  // namespace bromwich
