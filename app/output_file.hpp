#pragma once
// A file of the user that is written whole or not at all.

#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>

namespace bromwich::app {

/// Checks when made that FILE can be written, without touching it; write() fills a file beside it and puts it in FILE's
/// place. Where the file system offers it that file has no name until then, so that a killed process leaves nothing.
class OutputFile {
 public:
  /// Throws Error, naming `argument`, where the name does not end in `extension`, or the file or its folder cannot be
  /// written.
  OutputFile(const std::string& argument, const std::string& name, const std::string& extension);

  void write(const std::function<void(std::FILE*)>& fill) const;
  const std::string& name() const { return name_; }

 private:
  std::string argument_, name_;
  std::filesystem::path target_;     ///< symbolic links resolved, so that a link stays one
  std::filesystem::path temporary_;  ///< beside the target: a rename within one folder is atomic
};

}  // namespace bromwich::app
