#pragma once
// The table of a sweep: what may be asked of it, and its rows.

#include "app/columns.hpp"
#include "app/commands.hpp"
#include "app/measures.hpp"
#include "app/scene_blocks.hpp"
#include "batch/batch.hpp"
#include "catalogue/catalogue.hpp"
#include "core/base/threads.hpp"
#include "files/sweep.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// Throws Error for options that a sweep does not take, and for files of --out that it cannot write.
void check_sweep_arguments(const SolveArguments&, const ParameterValues& settings, const Sweep&);

/// A CSV file: one row for each scene, or for each scene and time.
class SweepTable {
 public:
  /// `states`: of the components in the results. `times`: of the rows of a scene; empty for one row.
  SweepTable(const Sweep&, std::vector<Column>, std::vector<Measure>, std::vector<Index> states,
             std::vector<double> times);

  std::string header() const;
  /// Of a block with its statuses. `places`: of its scenes in the result; -1 for one that was not read.
  std::string rows(const SceneBlock&, const BatchResult&, const std::vector<Index>& places, const HostThreads&) const;

 private:
  void add_row(std::string& text, const SceneBlock&, Index scene, const BatchResult&, Index place, Index at) const;
  void add_values(std::string& text, const BatchResult&, const Column&, Index place, Index at) const;
  Vector values(const BatchResult&, const Column&, Index place) const;

  const Sweep& sweep_;
  std::vector<Column> columns_;
  std::vector<Measure> measures_;
  std::vector<Index> states_;
  std::vector<double> times_;
};

}  // namespace bromwich::app
