#pragma once
// Archives of NumPy with entries as they are given, right or wrong.

#include <minizip/zip.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {

using ArchiveEntries = std::vector<std::pair<std::string, std::string>>;  ///< name, bytes

inline void write_archive(const std::filesystem::path& path, const ArchiveEntries& entries) {
  const zipFile zip = zipOpen64(path.c_str(), APPEND_STATUS_CREATE);
  for (const auto& [name, bytes] : entries) {
    const zip_fileinfo none{};
    zipOpenNewFileInZip64(zip, (name + ".npy").c_str(), &none, nullptr, 0, nullptr, 0, nullptr, 0, 0, 0);
    zipWriteInFileInZip(zip, bytes.data(), unsigned(bytes.size()));
    zipCloseFileInZip(zip);
  }
  zipClose(zip, nullptr);
}

}  // namespace bromwich
