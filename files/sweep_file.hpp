#pragma once
// Results of many scenes in HDF5: one array for all scenes and times, with the parameters as coordinates.
//
// dataset                  shape              meaning
// scene                    (scenes)           0, 1, ...; scale
// t                        (rows)             times; scale. With different T: times over T
// constraint, state        (n), (k)           scales
// each parameter           (scenes)           its values; a coordinate of y, w and x
// y, w, x                  (scenes, rows, .)  results; NaN where there is none
// residual                 (scenes)           of the complementarity
// status, reason, warning  (scenes)           texts

#include "../core/base/threads.hpp"
#include "result_file.hpp"
#include "sweep.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// Consecutive scenes: y, w and x have `rows` rows for each.
struct SweepRows {
  Eigen::Ref<const RowMatrix> parameters;
  Eigen::Ref<const Vector> residual;
  Eigen::Ref<const RowMatrix> y, w, x;
};

class SweepFile {
 public:
  virtual ~SweepFile() = default;
  /// Threads share the compression.
  virtual void append(const SweepRows&, const HostThreads&) = 0;
  /// After the last scene.
  virtual void finish(const std::vector<std::string>& status, const std::vector<std::string>& reason,
                      const std::vector<std::string>& warning, const Facts&) = 0;
};

/// The table of a sweep: one row for each scene.
struct StoredSweep {
  std::vector<std::string> parameters, columns, status;
  RowMatrix swept, values;  ///< scenes x parameters, scenes x columns
};

/// Of a file of create_sweep_hdf5: of each component of y and x its value in the last row, and its largest size, as the
/// CSV file of a sweep has them. Nothing for a file of another kind.
std::optional<StoredSweep> read_sweep_hdf5(const FileTarget&);

/// A new file, in place of an existing one. Throws Error without HDF5.
std::unique_ptr<SweepFile> create_sweep_hdf5(const FileTarget&, const ResultColumns&, const Sweep&, const Vector& t);

}  // namespace bromwich
