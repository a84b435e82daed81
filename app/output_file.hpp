#pragma once
// A file of the user that is written completely or not at all.

#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>

namespace bromwich::app {

/// The constructor checks that FILE can be written, without changing it. write() fills another file in the same folder
/// and replaces FILE by it. If the file system supports it, that file has no name until then, so a killed process
/// leaves nothing behind.
class OutputFile {
 public:
  /// Throws Error, naming `argument`, if the name does not end in `extension`, or if the file or its folder cannot be
  /// written.
  OutputFile(const std::string& argument, const std::string& name, const std::string& extension);

  void write(const std::function<void(std::FILE*)>& fill) const;
  const std::string& name() const { return name_; }
  const std::filesystem::path& target() const { return target_; }

 private:
  std::string argument_, name_;
  std::filesystem::path target_;     ///< with symbolic links resolved, so that links are kept
  std::filesystem::path temporary_;  ///< in the folder of the target: a rename within one folder is atomic
};

}  // namespace bromwich::app
