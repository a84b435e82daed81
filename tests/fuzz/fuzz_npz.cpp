// Results in archives of NumPy. The bytes are the entries, one after the other, each from its magic on: the sums of an
// archive would keep nearly all changes from the reader.

#include "files/stored_result.hpp"
#include "tests/fuzz/read.hpp"
#include "tests/support/archive.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace bromwich;
  const std::string_view bytes = fuzz::text(data, size), magic = "\x93NUMPY";
  ArchiveEntries entries;
  std::size_t begin = bytes.find(magic);
  for (const char* name : {"t", "y", "w", "x", "constraint_name", "state_name", "energy", "attribute_status"}) {
    if (begin == std::string_view::npos) break;
    const std::size_t end = bytes.find(magic, begin + 1);
    entries.emplace_back(name, bytes.substr(begin, end - begin));
    begin = end;
  }
  const std::filesystem::path path = fuzz::file_of(data, 0, ".npz");
  write_archive(path, entries);
  return fuzz::accepts([&] { read_npz({"FILE", path}); });
}
