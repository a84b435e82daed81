// HDF5 from the part of the command that has it, loaded at the first of these calls.

#include "core/base/error.hpp"
#include "files/hdf5_part.hpp"
#include "files/loaded_part.hpp"

namespace bromwich {

namespace {

const Hdf5Part& part(const FileTarget& target) {
  static const LoadedPart once = load_part("hdf5");
  if (!once.functions)
    throw Error(target.argument, "'" + target.path.string() + "' needs HDF5, and " + once.missing,
                "install the command again, with its libraries, or use a file .csv", ErrorKind::device);
  return *static_cast<const Hdf5Part*>(once.functions);
}

}  // namespace

void require_hdf5(const FileTarget& target) { part(target); }

std::unique_ptr<ResultFile> create_hdf5(const FileTarget& target, const ResultColumns& columns, Index expected_rows,
                                        const Facts& facts) {
  return part(target).create(target, columns, expected_rows, facts);
}

std::unique_ptr<ResultFile> continue_hdf5(const FileTarget& target, const ResultColumns& columns, Index rows,
                                          const std::string& run) {
  return part(target).continue_after(target, columns, rows, run);
}

std::unique_ptr<ResultFile> create_vtkhdf(const FileTarget& target, const FieldGrid& grid, const ResultColumns& columns,
                                          Index expected_rows, const Facts& facts) {
  return part(target).create_vtk(target, grid, columns, expected_rows, facts);
}

std::unique_ptr<ResultFile> continue_vtkhdf(const FileTarget& target, const FieldGrid& grid,
                                            const ResultColumns& columns, Index rows, const std::string& run) {
  return part(target).continue_vtk(target, grid, columns, rows, run);
}

std::unique_ptr<SweepFile> create_sweep_hdf5(const FileTarget& target, const ResultColumns& columns, const Sweep& sweep,
                                             const Vector& t) {
  return part(target).create_sweep(target, columns, sweep, t);
}

std::optional<StoredSweep> read_sweep_hdf5(const FileTarget& target) { return part(target).read_sweep(target); }

StoredResult read_hdf5(const FileTarget& target) { return part(target).read(target); }

void write_checkpoint(const FileTarget& target, const Checkpoint& checkpoint) {
  part(target).write_point(target, checkpoint);
}

Checkpoint read_checkpoint(const FileTarget& target) { return part(target).read_point(target); }

}  // namespace bromwich
