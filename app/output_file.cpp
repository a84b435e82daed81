#include "app/output_file.hpp"

#include "core/error.hpp"

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstring>

namespace bromwich::app {

namespace fs = std::filesystem;

namespace {

Error refused(const std::string& argument, const std::string& name, const std::string& why, const std::string& remedy) {
  return {argument, fmt::format("'{}' {}", name, why), remedy};
}

void check_name(const std::string& argument, const std::string& name, const std::string& extension) {
  std::string found = fs::path(name).extension();
  for (char& c : found) c = char(std::tolower(static_cast<unsigned char>(c)));
  const std::string remedy = "give a file name that ends in " + extension;
  if (name.empty() || name[0] == '-') throw refused(argument, name, "is not a file name", remedy);
  if (found == ".h5" || found == ".npz")
    throw refused(argument, name, "asks for a format that is not available yet", remedy);
  if (found != extension) throw refused(argument, name, fmt::format("does not end in {}", extension), remedy);
}

std::FILE* create(const fs::path& path) {
  const int descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  return descriptor < 0 ? nullptr : ::fdopen(descriptor, "w");
}

}  // namespace

OutputFile::OutputFile(const std::string& argument, const std::string& name, const std::string& extension)
    : argument_(argument), name_(name) {
  check_name(argument, name, extension);
  std::error_code failure;
  target_ = fs::weakly_canonical(fs::absolute(name, failure), failure);
  if (failure) throw refused(argument, name, "cannot be reached: " + failure.message(), "choose another file");
  const fs::path folder = target_.parent_path();
  if (!fs::is_directory(folder, failure))
    throw refused(argument, name, "lies in a folder that does not exist",
                  fmt::format("create {} first", folder.string()));
  const fs::file_status status = fs::status(target_, failure);
  if (fs::exists(status) && !fs::is_regular_file(status))
    throw refused(argument, name, "is not a regular file", "choose another file");
  if (fs::exists(status) && ::access(target_.c_str(), W_OK) != 0)
    throw refused(argument, name, "is write-protected", "choose another file");

  temporary_ = folder / fmt::format(".{}.{}.tmp", target_.filename().string(), ::getpid());
  std::FILE* probe = create(temporary_);
  if (!probe)
    throw refused(argument, name, fmt::format("cannot be written ({})", std::strerror(errno)), "choose another folder");
  std::fclose(probe);
  fs::remove(temporary_, failure);
}

void OutputFile::write(const std::function<void(std::FILE*)>& fill) const {
  std::FILE* file = create(temporary_);
  const auto fail = [&](const char* why) {
    std::error_code ignored;
    fs::remove(temporary_, ignored);
    return refused(argument_, name_, fmt::format("could not be written ({})", why),
                   "free some space or choose another folder");
  };
  if (!file) throw fail(std::strerror(errno));
  struct stat previous {};
  // Keeping the mode of the file that is replaced is a courtesy: a failure changes nothing that was promised.
  const bool replaces = ::stat(target_.c_str(), &previous) == 0;
  if (replaces && ::fchmod(::fileno(file), previous.st_mode & 07777) != 0) errno = 0;
  try {
    fill(file);
  } catch (...) {
    std::fclose(file);
    throw fail("writing stopped");
  }
  const bool bad = std::ferror(file) != 0;
  if (std::fclose(file) != 0 || bad) throw fail(errno ? std::strerror(errno) : "writing failed");
  std::error_code failure;
  fs::rename(temporary_, target_, failure);
  if (failure) throw fail(failure.message().c_str());
}

}  // namespace bromwich::app
