#include "files/matrix_forms.hpp"

#include "core/base/error.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <vector>

namespace bromwich {

namespace {

constexpr double largest_size = 1e7;

std::string trimmed(const std::string& text) {
  return one_line(text.substr(std::min(text.find_first_not_of(' '), text.size())));
}

/// "tridiag(n, -1, 2)": the word, and its arguments at commas outside of parentheses. Nothing if it is not of this
/// kind.
struct Call {
  std::string word;
  std::vector<std::string> arguments;
};
std::optional<Call> read_call(const std::string& text) {
  const std::string line = trimmed(text);
  const std::size_t open = line.find('(');
  if (open == std::string::npos) return Call{line, {}};
  if (line.back() != ')') return std::nullopt;
  Call call{trimmed(line.substr(0, open)), {}};
  int depth = 0;
  std::size_t begin = open + 1;
  for (std::size_t i = begin; i < line.size(); ++i) {
    depth += int(line[i] == '(') - int(line[i] == ')');
    if (depth < 0 ? i + 1 != line.size() : depth > 0 || line[i] != ',') continue;
    call.arguments.push_back(trimmed(line.substr(begin, i - begin)));
    begin = i + 1;
  }
  return call;
}

SparseMatrix tridiagonal(Index n, double lower, double diagonal, double upper) {
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < n; ++i) {
    if (i > 0) entries.emplace_back(i, i - 1, lower);
    entries.emplace_back(i, i, diagonal);
    if (i + 1 < n) entries.emplace_back(i, i + 1, upper);
  }
  SparseMatrix matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

// The same at all points of a grid: `centre`, and a number for both neighbours of each direction, the fastest last.
SparseMatrix stencil(const std::vector<Index>& extents, double centre, const std::vector<double>& beside) {
  Index n = 1;
  for (const Index extent : extents) n *= extent;
  std::vector<Eigen::Triplet<double>> entries;
  Index stride = n;
  for (std::size_t d = 0; d < extents.size(); ++d) {
    stride /= extents[d];
    for (Index i = 0; i < n; ++i) {
      if (d == 0) entries.emplace_back(i, i, centre);
      if (i / stride % extents[d] + 1 == extents[d]) continue;
      entries.emplace_back(i, i + stride, beside[d]);
      entries.emplace_back(i + stride, i, beside[d]);
    }
  }
  SparseMatrix matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

constexpr std::array<std::string_view, 4> forms{"identity", "zero", "tridiag", "stencil"};

}  // namespace

std::vector<std::string> matrix_forms() { return {forms.begin(), forms.end()}; }

std::optional<SparseMatrix> matrix_form(const std::string& text, Index rows, Index columns,
                                        const std::function<double(const std::string&)>& number,
                                        const std::string& where) {
  const std::optional<Call> call = read_call(text);
  if (!call || std::find(forms.begin(), forms.end(), call->word) == forms.end()) return std::nullopt;
  const std::string& word = call->word;
  const std::vector<std::string>& arguments = call->arguments;
  const std::size_t count = arguments.size();
  const auto refuse = [&](const std::string& remedy) {
    return Error(where, fmt::format("{} has {} argument{}", word, count, count == 1 ? "" : "s"), remedy);
  };
  const auto size = [&](std::size_t k) {
    const double value = number(arguments[k]);
    if (value != std::floor(value) || value < 1 || value > largest_size)
      throw Error(where, fmt::format("the size in {} is {}", word, value),
                  fmt::format("give a whole number from 1 to {}", largest_size));
    return Index(value);
  };
  if (word == "tridiag") {
    if (count != 4) throw refuse("write tridiag(n, lower, diagonal, upper)");
    return tridiagonal(size(0), number(arguments[1]), number(arguments[2]), number(arguments[3]));
  }
  if (word == "stencil") {
    if (count != 5) throw refuse("write stencil(points, points, centre, neighbours along, neighbours beside)");
    if (double(size(0)) * double(size(1)) > largest_size)
      throw Error(where, fmt::format("has {} x {} points", size(0), size(1)),
                  fmt::format("give at most {}", largest_size));
    return stencil({size(0), size(1)}, number(arguments[2]), {number(arguments[3]), number(arguments[4])});
  }
  if (count > 2) throw refuse(word == "zero" ? "write zero(rows, columns)" : "write identity(n) or identity(n, value)");
  if (count == 0 && (rows < 1 || columns < 1))
    throw Error(where, word + " has no size, and it does not follow from other matrices",
                fmt::format("write {}(n)", word));
  if (word == "zero") return count == 0 ? SparseMatrix(rows, columns) : SparseMatrix(size(0), size(count - 1));
  const Index n = count == 0 ? rows : size(0);
  return tridiagonal(n, 0, count == 2 ? number(arguments[1]) : 1, 0).pruned();
}

}  // namespace bromwich
