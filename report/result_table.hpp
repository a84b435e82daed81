#pragma once
// The columns of a result over time, from a solve or from a file.

#include "core/result/result.hpp"
#include "core/scene/scene.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace bromwich::report {

/// Columns of one kind.
struct Quantity {
  std::string symbol;              ///< "y", "w" or "x"; "" for other columns
  std::vector<std::string> names;  ///< of the columns, such as "y0"
  std::vector<std::string> units;  ///< of the columns, "" where not known
  RowMatrix values;                ///< rows x columns; NaN where there is no value
};

struct ResultTable {
  Vector t;                          ///< one time per row
  std::string time_unit;             ///< "" where not known
  std::vector<Quantity> quantities;  ///< those that have columns: y, w, x, others
  std::string summary;               ///< JSON that the file has, or what it says of a run without one; or empty
  std::string remark;                ///< the comment of a file on a result that ends early, or empty

  const Quantity* find(const std::string& symbol) const;  ///< null if there are no such columns
};

/// y, w and the recorded states; w only if N x was recorded (Options::trace).
ResultTable as_table(const Scene&, const Result&);

/// A file that `solve --out` wrote, by its extension: .csv, .h5 or .npz. `constraints`: n where it is known; columns
/// with names of their own are then y and x in this order. Throws Error(argument, ...) that names file and line.
ResultTable read_result(const std::string& argument, const std::filesystem::path&, Index constraints = -1);

}  // namespace bromwich::report
