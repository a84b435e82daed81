// NPZ where the library for zip archives was not found.

#include "core/base/error.hpp"
#include "files/stored_result.hpp"

namespace bromwich {

bool npz_available() { return false; }

namespace {

[[noreturn]] void refuse(const FileTarget& target) {
  throw Error(target.argument, "'" + target.path.string() + "' needs minizip, which this build does not have",
              "use a file .csv, or Result.save and bromwich.load of Python; a build with libminizip-dev has it");
}

}  // namespace

void write_npz(const FileTarget& target, const ResultColumns&, const ResultRows&, const std::vector<TimeSeries>&,
               const Facts&, std::FILE*) {
  refuse(target);
}

StoredResult read_npz(const FileTarget& target) { refuse(target); }

}  // namespace bromwich
