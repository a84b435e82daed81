#pragma once
// HDF5 files that grow and stay readable if the process is killed.
//
// Metadata stays in memory between flushes, freed space is not used again, and chunks go to the file when they are
// written: the file is always that of the last flush. A flush itself is a few writes.

#include "files/result_file.hpp"

#include <hdf5.h>

#include <string>
#include <utility>
#include <vector>

namespace bromwich::hdf5 {

/// An identifier of the library, closed at the end.
class Handle {
 public:
  Handle() = default;
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  ~Handle() { reset(); }
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    reset();
    id_ = std::exchange(other.id_, -1);
    close_ = other.close_;
    return *this;
  }

  operator hid_t() const { return id_; }
  hid_t release() { return std::exchange(id_, -1); }

 private:
  void reset() {
    if (id_ >= 0) close_(std::exchange(id_, -1));
  }
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

/// A file that this process alone writes; others may read it at the same time.
class File {
 public:
  enum class Access { create, write, read };
  /// `chunks`: expected number of the largest dataset (create only).
  File(FileTarget target, Access access, Index chunks = 0);
  ~File();
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  operator hid_t() const { return file_; }
  const FileTarget& target() const { return target_; }

  /// Passes a result of the library on. If it is negative: throws Error with the reason, and nothing more is written.
  template <typename Code>
  Code checked(Code code) {
    if (code < 0) fail();
    return code;
  }
  /// Throws Error after a failure: what the library still holds must not get into the file.
  void require_whole();
  void flush() {
    require_whole();
    extend();
    checked(H5Fflush(file_, H5F_SCOPE_LOCAL));
  }
  /// Ends the file and reports failures; otherwise the destructor ends it in silence.
  void close();

 private:
  /// Makes the file as long as its superblock will say. A file that is shorter, since the process was killed within a
  /// flush, could not be opened.
  void extend();

  /// Keeps other processes of this program from writing the file.
  class Lock {
   public:
    explicit Lock(const FileTarget*);  ///< null: none
    ~Lock();
    Lock(const Lock&) = delete;
    Lock& operator=(const Lock&) = delete;

   private:
    int descriptor_ = -1;
  };

  [[noreturn]] void fail();

  FileTarget target_;
  Access access_;
  Lock lock_;
  Handle file_;
  bool failed_ = false;
};

using Shape = std::vector<hsize_t>;

inline constexpr unsigned compression = 1;  ///< of 9: higher levels cost time and save little after the shuffle

/// Attributes of a file, group or dataset; an existing one is replaced.
void set_attribute(File&, hid_t object, const std::string& name, const std::string& value);  ///< UTF-8
void set_attribute(File&, hid_t object, const std::string& name, double value);
void set_attribute(File&, hid_t object, const std::string& name, std::int64_t value);
void set_attribute(File&, hid_t object, const std::string& name, const std::vector<double>& values);
void set_attribute(File&, hid_t object, const std::string& name, const std::vector<std::int64_t>& values);
void set_attributes(File&, hid_t object, const Facts&);

/// The text of an attribute; "" if there is none.
std::string text_attribute(File&, hid_t object, const std::string& name);

/// A dataset without rows: shape[0] grows, chunks hold `chunk_rows` rows. Compressed (shuffle and deflate).
Handle growing_dataset(File&, hid_t group, const std::string& name, hid_t type, const Shape& row, Index chunk_rows);
/// A dataset of fixed size with these values.
Handle fixed_dataset(File&, hid_t group, const std::string& name, hid_t type, const Shape& shape, const void* values);
Handle text_dataset(File&, hid_t group, const std::string& name, const std::vector<std::string>& values);
Handle open_dataset(File&, hid_t group, const std::string& name);

/// The shape of a dataset; rows = shape[0].
Shape shape_of(File&, hid_t dataset);
/// The same before memory is taken for all values. Throws Error if there are more than a file of this size can hold.
Shape shape_to_read(File&, hid_t dataset);
/// Cuts or extends the dataset to `rows` rows.
void set_rows(File&, hid_t dataset, Index rows);
/// Appends `count` rows from consecutive memory.
void append_rows(File&, hid_t dataset, hid_t memory_type, Index first, Index count, const void* values);
/// Reads all of it.
void read_all(File&, hid_t dataset, hid_t memory_type, void* values);

/// Reads `count` rows.
void read_rows(File&, hid_t dataset, hid_t memory_type, Index first, Index count, void* values);

/// Rows of a chunk, for rows of `width` numbers.
Index rows_per_chunk(Index width);
/// Rows that are appended between two flushes.
Index rows_per_flush(Index width);

}  // namespace bromwich::hdf5
