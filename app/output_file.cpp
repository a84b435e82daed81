#include "app/output_file.hpp"

#include "app/interaction.hpp"
#include "app/ranks.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cctype>
#include <cerrno>
#include <cstring>
#include <tuple>
#include <utility>

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
  if (found != extension) throw refused(argument, name, fmt::format("does not end in {}", extension), remedy);
}

/// The target of a file name, whether it exists or not: symbolic links are followed, also dangling ones.
fs::path resolve(const std::string& name, std::error_code& failure) {
  fs::path path = fs::absolute(name, failure);
  for (int links = 0; !failure && links < 40; ++links) {
    path = fs::weakly_canonical(path.parent_path(), failure) / path.filename();
    if (failure || !fs::is_symlink(fs::symlink_status(path, failure))) {
      if (failure == std::errc::no_such_file_or_directory || failure == std::errc::not_a_directory) failure.clear();
      return path;
    }
    const fs::path next = fs::read_symlink(path, failure);
    path = next.is_absolute() ? next : path.parent_path() / next;
  }
  if (!failure) failure = std::make_error_code(std::errc::too_many_symbolic_link_levels);
  return path;
}

/// The file while it is written: without a name, or with a temporary name if the file system needs one.
class Unfinished {
 public:
  explicit Unfinished(const fs::path& temporary) : temporary_(temporary) {
    int descriptor = -1;
#ifdef O_TMPFILE
    // It gets its name through /proc.
    if (::access("/proc/self/fd", X_OK) == 0)
      descriptor = ::open(temporary.parent_path().c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666);
#endif
    if (descriptor < 0) {
      const SignalsWait wait;
      descriptor = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
      named_ = descriptor >= 0;
      if (named_) remove_when_killed(temporary);
    }
    if (descriptor < 0) return;
    file_ = ::fdopen(descriptor, "w");
    if (!file_) ::close(descriptor);
  }
  ~Unfinished() {
    if (file_) std::fclose(file_);
    if (!named_) return;
    ::unlink(temporary_.c_str());
    remove_when_killed("");
  }
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;

  std::FILE* file() const { return file_; }

  /// Replaces `target` by the complete file. False, with errno, if that fails.
  bool finish(const fs::path& target) {
    const SignalsWait wait;  // while the temporary name exists
    const bool written = std::ferror(file_) == 0 && std::fflush(file_) == 0;
    if (!written) return false;
    if (!named_) {
      const std::string self = fmt::format("/proc/self/fd/{}", ::fileno(file_));
      named_ = ::linkat(AT_FDCWD, self.c_str(), AT_FDCWD, temporary_.c_str(), AT_SYMLINK_FOLLOW) == 0;
      if (!named_) return false;
    }
    std::FILE* file = std::exchange(file_, nullptr);
    if (std::fclose(file) != 0 || ::rename(temporary_.c_str(), target.c_str()) != 0) return false;
    named_ = false;
    remove_when_killed("");
    return true;
  }

 private:
  fs::path temporary_;
  bool named_ = false;  ///< `temporary_` exists
  std::FILE* file_ = nullptr;
};

}  // namespace

OutputFile::OutputFile(const std::string& argument, const std::string& name, const std::string& extension)
    : argument_(argument), name_(name) {
  check_name(argument, name, extension);
  std::error_code failure;
  target_ = resolve(name, failure);
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
  if (!Unfinished(temporary_).file())
    throw refused(argument, name, fmt::format("cannot be written ({})", std::strerror(errno)), "choose another folder");
}

void OutputFile::write(const std::function<void(std::FILE*)>& fill) const {
  if (!first_rank()) return;
  const auto fail = [&](const char* why) {
    return refused(argument_, name_, fmt::format("could not be written ({})", why),
                   "free some space, raise ulimit -f, or choose another folder");
  };
  Unfinished unfinished(temporary_);
  if (!unfinished.file()) throw fail(std::strerror(errno));
  struct stat previous {};
  // The mode of the replaced file is kept if possible; a failure is ignored.
  if (::stat(target_.c_str(), &previous) == 0)
    std::ignore = ::fchmod(::fileno(unfinished.file()), previous.st_mode & 07777);
  errno = 0;
  fill(unfinished.file());
  if (!unfinished.finish(target_)) throw fail(errno ? std::strerror(errno) : "writing failed");
}

}  // namespace bromwich::app
