#pragma once
// The file of --out, in the format of its extension. CSV and NPZ are written whole, at the end; HDF5 and VTKHDF exist
// from the start and grow.

#include "app/columns.hpp"
#include "app/output_csv.hpp"
#include "app/output_file.hpp"
#include "core/dynamics/rectangle.hpp"
#include "core/scene/scene.hpp"
#include "files/result_file.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::app {

enum class ResultFormat { csv, hdf5, npz, vtkhdf };

/// By the extension of the name. Throws Error, naming `argument`, for another one.
ResultFormat result_format(const std::string& argument, const std::string& name);

/// The points of the states of a scene on a rectangle; empty for others.
std::optional<FieldGrid> field_grid(const Scene&, const std::optional<Rectangle>&);

class ResultOutput {
 public:
  /// Checks that the file can be written, without changing it. Throws Error, naming `argument`.
  /// `rectangle`: whose states the scene has, if it is one.
  ResultOutput(const std::string& argument, const std::string& name, const Scene&,
               const std::optional<Rectangle>& rectangle = {});
  /// Says in a growing file that the run has failed, unless finish() was called.
  ~ResultOutput();
  ResultOutput(const ResultOutput&) = delete;
  ResultOutput& operator=(const ResultOutput&) = delete;

  ResultFormat format() const { return format_; }
  /// HDF5 and VTKHDF.
  bool grows() const { return format_ == ResultFormat::hdf5 || format_ == ResultFormat::vtkhdf; }
  /// Whether w is written where the result has N x.
  bool with_slack() const { return format_ != ResultFormat::csv; }
  const std::string& name() const { return file_.name(); }

  /// Throws Error if the format cannot hold these states.
  void check_states(const std::vector<Index>& states) const;

  /// Before the solve: creates a growing file with these facts and status "running". `rows` is an estimate.
  void begin(const std::vector<Index>& states, Index rows, Facts facts);
  /// Continues a growing file of this run after `rows` rows.
  void resume(const std::vector<Index>& states, Index rows, const std::string& run);
  bool exists() const;

  /// Appends rows `first` to `last` of a part of the run to a growing file. Its columns of x are selected.
  void append(const Scene& part, const Result&, const Vector& t, Index first, Index last);

  /// What was appended is in the file when this returns.
  void flush();

  /// The whole result, or `sampled` rows of it at other times. `columns`: of a CSV file.
  void write(const Result& sampled, const Result& result, const std::vector<Column>& columns,
             const std::vector<TimeSeries>& contacts, const Energies* energies, const Facts& facts);
  /// The facts of the end, for a file that was written by append().
  void finish(const Facts& facts);

 private:
  ResultColumns columns(const std::vector<Index>& states) const;
  /// Throws Error if the scene has no grid.
  FieldGrid grid() const;

  std::string argument_;
  ResultFormat format_;
  OutputFile file_;
  const Scene& scene_;
  std::optional<Rectangle> rectangle_;
  std::vector<Index> states_;
  Facts facts_;  ///< known before the solve
  std::unique_ptr<ResultFile> growing_;
  bool finished_ = false;
};

/// The number of rows up to the last one with a value.
Index valid_rows(const Result&);

}  // namespace bromwich::app
