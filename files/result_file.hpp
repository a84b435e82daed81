#pragma once
// Results in files: one layout for all formats, docs/output.md describes it. A file holds the times t, y, w = N x + M y
// + g, selected components of x, and facts about the solve (status, method, errors, provenance).

#include "core/base/types.hpp"

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace bromwich {

/// A named value: an attribute of an HDF5 file, an array of no dimension in an NPZ file.
using Fact = std::variant<std::string, double, std::int64_t>;
using Facts = std::vector<std::pair<std::string, Fact>>;

/// What a file of results holds at every time.
struct ResultColumns {
  Index constraints = 0;                       ///< columns of y and w
  bool slack = false;                          ///< w is there
  std::vector<Index> states;                   ///< components of the state: the columns of x
  std::vector<std::string> constraint_names;   ///< one per constraint; empty: y0, y1, ...
  std::vector<std::string> state_names;        ///< one per entry of `states`; empty: x<component>
  std::string t_unit, y_unit, w_unit, x_unit;  ///< empty: not known
};

std::vector<std::string> constraint_names(const ResultColumns&);
std::vector<std::string> state_names(const ResultColumns&);

/// Consecutive rows: `count` times, and as many rows of y, w and x. What has no columns is not read.
struct ResultRows {
  Eigen::Ref<const Vector> t;
  Eigen::Ref<const RowMatrix> y, w, x;
};

/// One more quantity with a value at every time, such as the energy.
struct TimeSeries {
  std::string name, meaning;
  Vector values;
};

/// The file of an argument, "--out" and its path: messages name both.
struct FileTarget {
  std::string argument;
  std::filesystem::path path;
};

/// A file that grows while a result is computed. It can be read at any time, also if the process is killed: it holds
/// all rows up to the last flush(), and those that came after it in whole chunks. Every function throws Error if
/// writing fails; what was written before stays.
class ResultFile {
 public:
  virtual ~ResultFile() = default;
  virtual void append(const ResultRows&) = 0;
  virtual void flush() = 0;
  virtual void set(const Facts&) = 0;  ///< replaces facts of the same name, and flushes
  /// After the last row.
  virtual void add(const std::vector<TimeSeries>&) = 0;
  virtual Index rows() const = 0;  ///< that were appended, and those the file had before
};

/// Throws Error if there is no HDF5, as the functions below do: it names what is missing.
void require_hdf5(const FileTarget&);

/// A new file, in place of an existing one. `expected_rows` is an estimate for the size of its index.
std::unique_ptr<ResultFile> create_hdf5(const FileTarget&, const ResultColumns&, Index expected_rows, const Facts&);

/// An existing file, continued after its first `rows` rows. Throws Error if it has fewer, if its columns are others, or
/// if its fact "run" is not `run`.
std::unique_ptr<ResultFile> continue_hdf5(const FileTarget&, const ResultColumns&, Index rows, const std::string& run);

/// The points of a rectangle: state index = line * across + position on the line, one constraint per line, or then one
/// more per line on the opposite side.
struct FieldGrid {
  Index along = 0, across = 0;
  double along_spacing = 0, across_spacing = 0;
  double along_first = 0, across_first = 0;  ///< where the first points lie; 0: one spacing from the side
};

/// The same as VTKHDF: an image whose point data y and w have the value of constraint i on all points of line i, or on
/// the half of it that is next to the constraint. With all states (columns.states = 0, 1, ...) the image is the
/// rectangle and has x, without states it is two points wide.
std::unique_ptr<ResultFile> create_vtkhdf(const FileTarget&, const FieldGrid&, const ResultColumns&,
                                          Index expected_rows, const Facts&);
std::unique_ptr<ResultFile> continue_vtkhdf(const FileTarget&, const FieldGrid&, const ResultColumns&, Index rows,
                                            const std::string& run);

/// False if this build has no zip library: write_npz then throws an Error that names the missing package.
bool npz_available();

/// All rows as NPZ (numpy.load). Failures show in ferror(file).
void write_npz(const FileTarget&, const ResultColumns&, const ResultRows&, const std::vector<TimeSeries>&, const Facts&,
               std::FILE* file);

}  // namespace bromwich
