#pragma once
// What the targets of libFuzzer share. An Error is the answer to bad input; every other exception is a fault, and so
// are what the sanitizers find, more than 2 GB of memory and more than some seconds for a small file.

#include "core/base/error.hpp"

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

namespace bromwich::fuzz {

template <class Read>
int accepts(Read&& read) {
  try {
    std::forward<Read>(read)();
  } catch (const Error& refused) {
    if (refused.kind() == ErrorKind::internal) std::abort();
  }
  return 0;
}

inline std::string_view text(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// The bytes as a file, for readers of files; one for each process.
inline std::filesystem::path file_of(const std::uint8_t* data, std::size_t size, const char* extension) {
  static const std::filesystem::path folder = [] {
    std::string name = (std::filesystem::temp_directory_path() / "bromwich-fuzz-XXXXXX").string();
    return std::filesystem::path(mkdtemp(name.data()));
  }();
  const std::filesystem::path path = folder / (std::string("input") + extension);
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(data), std::streamsize(size));
  return path;
}

}  // namespace bromwich::fuzz
