// NPZ where the library for zip archives was not found.

#include "core/base/error.hpp"
#include "files/result_file.hpp"

namespace bromwich {

bool npz_available() { return false; }

void write_npz(const FileTarget& target, const ResultColumns&, const ResultRows&, const Facts&, std::FILE*) {
  throw Error(target.argument, "'" + target.path.string() + "' needs minizip, which this build does not have",
              "install libminizip-dev and build again, or write a file .csv");
}

}  // namespace bromwich
