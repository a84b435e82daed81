#pragma once
// Matrices and tables in files: Matrix Market, and numbers separated by commas. Every Error names the file and line.

#include "core/base/time_function.hpp"
#include "core/base/types.hpp"

#include <filesystem>
#include <string>
#include <variant>
#include <vector>

namespace bromwich {

/// Dense, or sparse if the file lists positions.
using MatrixValue = std::variant<Matrix, SparseMatrix>;

Index rows(const MatrixValue&);
Index columns(const MatrixValue&);

/// Its name in messages, and its path.
struct NumberFile {
  std::string name;
  std::filesystem::path path;
};

/// The whole file. Throws Error(where, ...) if it cannot be read; `where` is the place that names it.
std::string read_text(const NumberFile& file, const std::string& where);

/// Matrix Market: coordinate or array; real, integer or pattern; general, symmetric or skew-symmetric. Positions given
/// twice are summed.
MatrixValue read_matrix_market(const std::string& text, const std::string& name);

/// Rows of equally many numbers separated by commas; blank lines and lines that begin with # are skipped.
Matrix read_number_table(const std::string& text, const std::string& name);

/// Times and one column of values per entry, from a file with the header `t,f0,f1,...` (`letter` = f).
struct TimeTable {
  Vector t;  ///< ascending; a time given twice is a jump from the values of its first row to those of its second
  RowMatrix values;  ///< t.size() x entries
  std::string end;   ///< of the file, for messages
};
/// Throws if the header is wrong, if the times do not ascend from at most 0 on, or if a time is given three times.
TimeTable read_time_table(const std::string& text, const std::string& name, char letter);
/// Throws if the times end before `last_time`.
void require_times_until(const TimeTable&, double last_time);

/// Piecewise linear in t, constant before the first and after the last time; continuous from the right at jumps.
TimeFunction interpolate(TimeTable table);

/// The times in (0, last_time) at which the interpolant jumps or has a kink. Rows on a straight line do not count.
std::vector<double> kinks(const TimeTable& table, double last_time);

}  // namespace bromwich
