// HDF5 where the library was not found.

#include "core/base/error.hpp"
#include "files/checkpoint.hpp"
#include "files/stored_result.hpp"
#include "files/sweep_file.hpp"

namespace bromwich {

namespace {

[[noreturn]] void refuse(const FileTarget& target) {
  throw Error(target.argument, "'" + target.path.string() + "' needs HDF5, which this build does not have",
              "use a file .csv, or Result.save and bromwich.load of Python; a build with libhdf5-dev has it");
}

}  // namespace

void require_hdf5(const FileTarget& target) { refuse(target); }

std::unique_ptr<ResultFile> create_hdf5(const FileTarget& target, const ResultColumns&, Index, const Facts&) {
  refuse(target);
}

std::unique_ptr<ResultFile> continue_hdf5(const FileTarget& target, const ResultColumns&, Index, const std::string&) {
  refuse(target);
}

std::unique_ptr<ResultFile> create_vtkhdf(const FileTarget& target, const FieldGrid&, const ResultColumns&, Index,
                                          const Facts&) {
  refuse(target);
}

std::unique_ptr<ResultFile> continue_vtkhdf(const FileTarget& target, const FieldGrid&, const ResultColumns&, Index,
                                            const std::string&) {
  refuse(target);
}

std::unique_ptr<SweepFile> create_sweep_hdf5(const FileTarget& target, const ResultColumns&, const Sweep&,
                                             const Vector&) {
  refuse(target);
}

std::optional<StoredSweep> read_sweep_hdf5(const FileTarget& target) { refuse(target); }

StoredResult read_hdf5(const FileTarget& target) { refuse(target); }

void write_checkpoint(const FileTarget& target, const Checkpoint&) { refuse(target); }

Checkpoint read_checkpoint(const FileTarget& target) { refuse(target); }

}  // namespace bromwich
