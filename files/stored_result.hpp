#pragma once
// Results that were written to files (result_file.hpp, or the Python package in the same layout), read again.

#include "files/result_file.hpp"

namespace bromwich {

struct StoredResult {
  Vector t;
  RowMatrix y, w, x;  ///< rows x columns; empty where the file has none
  std::vector<std::string> constraint_names, state_names;
  std::string t_unit, y_unit, w_unit, x_unit;  ///< "" where not known
  std::vector<TimeSeries> others;              ///< further quantities with a value at every time
  Facts facts;

  std::string text(const std::string& name) const;  ///< of a fact; "" if there is none
};

/// Throws Error that names the argument and the file if it cannot be read or holds no result.
StoredResult read_hdf5(const FileTarget&);
StoredResult read_npz(const FileTarget&);

/// Throws Error unless the arrays have a row for each time.
void require_rows(const FileTarget&, const StoredResult&);

}  // namespace bromwich
