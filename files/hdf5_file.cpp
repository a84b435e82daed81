#include "files/hdf5_file.hpp"

#include "core/base/error.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <limits>

namespace bromwich::hdf5 {

namespace {

constexpr Index values_per_chunk = 1 << 17;  ///< 1 MiB: large enough for the disk, small enough to read rows
constexpr Index values_per_flush = 1 << 19;  ///< 4 MiB
constexpr Index fewest_rows_per_chunk = 1;
constexpr Index most_rows_per_chunk = 1 << 12;  ///< chunks of narrow results, which are rewritten when they grow
constexpr unsigned fewest_index_entries = 32, most_index_entries = 4096;  ///< half of a node of the index of chunks

/// Once, before anything else of the library: no messages of its own, and no flush at the end of the process.
void prepare_library() {
  static const bool prepared = [] {
    H5dont_atexit();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    return true;
  }();
  (void)prepared;
}

struct Failure {
  std::string text;  ///< the description of the innermost one
  int number = 0;    ///< errno, if the library has seen one
};

herr_t collect(unsigned /*n*/, const H5E_error2_t* error, void* into) {
  auto& failure = *static_cast<Failure*>(into);
  const std::string text = error->desc ? error->desc : "";
  if (failure.text.empty()) failure.text = text;
  const std::string word = "errno = ";
  if (const auto at = text.find(word); at != std::string::npos && failure.number == 0)
    failure.number = std::atoi(text.c_str() + at + word.size());
  return 0;
}

Failure library_failure() {
  Failure failure;
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, collect, &failure);
  H5Eclear2(H5E_DEFAULT);
  if (failure.text.empty()) failure.text = "the HDF5 library failed";
  if (failure.number != 0) failure.text = std::strerror(failure.number);
  return failure;
}

/// Metadata is written by flushes alone.
herr_t keep_metadata(hid_t access) {
  H5AC_cache_config_t config{};
  config.version = H5AC__CURR_CACHE_CONFIG_VERSION;
  if (H5Pget_mdc_config(access, &config) < 0) return -1;
  config.evictions_enabled = false;
  config.incr_mode = H5C_incr__off;
  config.flash_incr_mode = H5C_flash_incr__off;
  config.decr_mode = H5C_decr__off;
  return H5Pset_mdc_config(access, &config);
}

Handle text_type() {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type, H5T_VARIABLE);
  H5Tset_cset(type, H5T_CSET_UTF8);
  return type;
}

void write_attribute(File& file, hid_t object, const std::string& name, hid_t stored, hid_t memory, hid_t space,
                     const void* values) {
  if (file.checked(H5Aexists(object, name.c_str())) > 0) file.checked(H5Adelete(object, name.c_str()));
  const Handle attribute(file.checked(H5Acreate2(object, name.c_str(), stored, space, H5P_DEFAULT, H5P_DEFAULT)),
                         H5Aclose);
  file.checked(H5Awrite(attribute, memory, values));
}

Handle scalar() { return {H5Screate(H5S_SCALAR), H5Sclose}; }

Handle line(std::size_t length) {
  const hsize_t size = length;
  return {H5Screate_simple(1, &size, nullptr), H5Sclose};
}

}  // namespace

File::File(FileTarget target, Access access, Index chunks)
    : target_(std::move(target)), access_(access), lock_(access == Access::read ? nullptr : &target_) {
  prepare_library();
  const Handle properties(checked(H5Pcreate(H5P_FILE_ACCESS)), H5Pclose);
  checked(H5Pset_file_locking(properties, false, true));  // others may read
  checked(keep_metadata(properties));
  const char* path = target_.path.c_str();
  if (access != Access::create) {
    file_ =
        Handle(checked(H5Fopen(path, access == Access::read ? H5F_ACC_RDONLY : H5F_ACC_RDWR, properties)), H5Fclose);
    return;
  }
  const Handle creation(checked(H5Pcreate(H5P_FILE_CREATE)), H5Pclose);
  // What the last flush refers to is not overwritten.
  checked(H5Pset_file_space_strategy(creation, H5F_FSPACE_STRATEGY_NONE, false, 1));
  // The index of the chunks of a dataset is one node: a flush writes it at once.
  const auto entries = unsigned(std::clamp<Index>(chunks / 2 + 1, fewest_index_entries, most_index_entries));
  checked(H5Pset_istore_k(creation, entries));
  checked(H5Pset_link_creation_order(creation, H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED));
  file_ = Handle(checked(H5Fcreate(path, H5F_ACC_TRUNC, creation, properties)), H5Fclose);
  extend();  // the superblock has been written
}

File::~File() {
  // After a failure the file stays open until the end of the process: closing would write incomplete metadata.
  if (failed_) file_.release();
}

File::Lock::Lock(const FileTarget* target) {
  if (!target) return;
  const std::string name = "'" + target->path.string() + "' ";
  descriptor_ = ::open(target->path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor_ < 0)
    throw Error(target->argument, name + "cannot be written (" + std::strerror(errno) + ")", "choose another file");
  struct flock whole {};
  whole.l_type = F_WRLCK;
  whole.l_whence = SEEK_SET;
  // File systems without locks: nothing is known of other processes.
  if (::fcntl(descriptor_, F_OFD_SETLK, &whole) == 0 || (errno != EAGAIN && errno != EACCES)) return;
  ::close(descriptor_);
  throw Error(target->argument, name + "is being written by another process",
              "choose another file, or wait until that one has ended");
}

File::Lock::~Lock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void File::extend() {
  haddr_t end = 0;
  void* driver = nullptr;
  struct stat now {};
  if (H5Fget_eoa(file_, &end) < 0 || H5Fget_vfd_handle(file_, H5P_DEFAULT, &driver) < 0 || !driver) return;
  const int descriptor = *static_cast<const int*>(driver);
  const bool shorter = ::fstat(descriptor, &now) == 0 && hsize_t(now.st_size) < end;
  if (shorter && ::ftruncate(descriptor, off_t(end)) != 0) errno = 0;  // the flush says what is wrong
}

void File::require_whole() {
  if (failed_)
    throw Error(target_.argument, "'" + target_.path.string() + "' could not be written before", "choose another file");
}

void File::close() {
  flush();
  const hid_t file = file_.release();
  checked(H5Fclose(file));
}

void File::fail() {
  const auto [found, number] = library_failure();
  failed_ = true;
  const std::string name = "'" + target_.path.string() + "' ";
  if (access_ == Access::read)
    throw Error(target_.argument, name + "could not be read (" + found + ")", "give an HDF5 file that is whole");
  const bool space = number == ENOSPC || number == EFBIG || number == EDQUOT;
  throw Error(target_.argument, name + "could not be written (" + found + "); rows before stay in it",
              space ? "free some space, raise ulimit -f, or choose another folder" : "choose another file");
}

void set_attribute(File& file, hid_t object, const std::string& name, const std::string& value) {
  const Handle type = text_type(), space = scalar();
  const char* text = value.c_str();
  write_attribute(file, object, name, type, type, space, &text);
}

void set_attribute(File& file, hid_t object, const std::string& name, double value) {
  write_attribute(file, object, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, scalar(), &value);
}

void set_attribute(File& file, hid_t object, const std::string& name, std::int64_t value) {
  write_attribute(file, object, name, H5T_STD_I64LE, H5T_NATIVE_INT64, scalar(), &value);
}

void set_attribute(File& file, hid_t object, const std::string& name, const std::vector<double>& values) {
  write_attribute(file, object, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, line(values.size()), values.data());
}

void set_attribute(File& file, hid_t object, const std::string& name, const std::vector<std::int64_t>& values) {
  write_attribute(file, object, name, H5T_STD_I64LE, H5T_NATIVE_INT64, line(values.size()), values.data());
}

void set_attributes(File& file, hid_t object, const Facts& facts) {
  for (const auto& [name, fact] : facts)
    std::visit([&, &key = name](const auto& value) { set_attribute(file, object, key, value); }, fact);
}

std::string text_attribute(File& file, hid_t object, const std::string& name) {
  if (file.checked(H5Aexists(object, name.c_str())) == 0) return "";
  const Handle attribute(file.checked(H5Aopen(object, name.c_str(), H5P_DEFAULT)), H5Aclose);
  const Handle stored(file.checked(H5Aget_type(attribute)), H5Tclose);
  if (H5Tget_class(stored) != H5T_STRING || H5Tis_variable_str(stored) <= 0) return "";
  const Handle type = text_type();
  char* text = nullptr;
  file.checked(H5Aread(attribute, type, static_cast<void*>(&text)));
  const std::string value = text ? text : "";
  H5free_memory(text);
  return value;
}

Handle growing_dataset(File& file, hid_t group, const std::string& name, hid_t type, const Shape& row,
                       Index chunk_rows) {
  Shape size{0}, most{H5S_UNLIMITED}, chunk{hsize_t(chunk_rows)};
  for (const hsize_t length : row) {
    size.push_back(length);
    most.push_back(length);
    chunk.push_back(length);
  }
  // One row may be too large for a chunk.
  hsize_t values = 1;
  for (const hsize_t length : chunk) values *= length;
  for (std::size_t i = 1; i < chunk.size() && values > hsize_t(values_per_chunk); ++i) {
    const hsize_t others = values / chunk[i];
    chunk[i] = std::max<hsize_t>(1, hsize_t(values_per_chunk) / others);
    values = others * chunk[i];
  }
  const Handle space(file.checked(H5Screate_simple(int(size.size()), size.data(), most.data())), H5Sclose);
  const Handle creation(file.checked(H5Pcreate(H5P_DATASET_CREATE)), H5Pclose);
  file.checked(H5Pset_chunk(creation, int(chunk.size()), chunk.data()));
  file.checked(H5Pset_shuffle(creation));
  file.checked(H5Pset_deflate(creation, compression));
  const double nothing = std::numeric_limits<double>::quiet_NaN();
  if (H5Tget_class(type) == H5T_FLOAT) file.checked(H5Pset_fill_value(creation, H5T_NATIVE_DOUBLE, &nothing));
  // No chunk waits in memory: a failure shows before the index refers to it.
  const Handle access(file.checked(H5Pcreate(H5P_DATASET_ACCESS)), H5Pclose);
  file.checked(H5Pset_chunk_cache(access, 0, 0, 0));
  return {file.checked(H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, creation, access)), H5Dclose};
}

Handle fixed_dataset(File& file, hid_t group, const std::string& name, hid_t type, const Shape& shape,
                     const void* values) {
  const Handle space(file.checked(H5Screate_simple(int(shape.size()), shape.data(), nullptr)), H5Sclose);
  Handle dataset(file.checked(H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)),
                 H5Dclose);
  file.checked(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values));
  return dataset;
}

Handle text_dataset(File& file, hid_t group, const std::string& name, const std::vector<std::string>& values) {
  std::vector<const char*> pointers;
  for (const std::string& value : values) pointers.push_back(value.c_str());
  const Handle type = text_type();
  return fixed_dataset(file, group, name, type, {values.size()}, static_cast<const void*>(pointers.data()));
}

Handle open_dataset(File& file, hid_t group, const std::string& name) {
  const Handle access(file.checked(H5Pcreate(H5P_DATASET_ACCESS)), H5Pclose);
  file.checked(H5Pset_chunk_cache(access, 0, 0, 0));
  return {file.checked(H5Dopen2(group, name.c_str(), access)), H5Dclose};
}

Shape shape_of(File& file, hid_t dataset) {
  const Handle space(file.checked(H5Dget_space(dataset)), H5Sclose);
  Shape shape(std::size_t(file.checked(H5Sget_simple_extent_ndims(space))));
  file.checked(H5Sget_simple_extent_dims(space, shape.data(), nullptr));
  return shape;
}

Shape shape_to_read(File& file, hid_t dataset) {
  constexpr hsize_t most_of_a_byte = 1032;  // that deflate can make of a byte
  Shape shape = shape_of(file, dataset);
  hsize_t most = (hsize_t(std::filesystem::file_size(file.target().path)) + 1024) * most_of_a_byte;
  if (std::find(shape.begin(), shape.end(), hsize_t(0)) != shape.end()) return shape;
  for (const hsize_t size : shape) {
    most /= size;
    if (most == 0)
      throw Error(file.target().argument,
                  "'" + file.target().path.string() + "' has a dataset that is larger than the file can hold",
                  "give a file that is whole");
  }
  return shape;
}

void set_rows(File& file, hid_t dataset, Index rows) {
  Shape shape = shape_of(file, dataset);
  shape[0] = hsize_t(rows);
  file.checked(H5Dset_extent(dataset, shape.data()));
}

namespace {

// Spaces of consecutive rows, in memory and in the file.
std::pair<Handle, Handle> part_of(File& file, hid_t dataset, Index first, Index count) {
  Handle space(file.checked(H5Dget_space(dataset)), H5Sclose);
  Shape size = shape_of(file, dataset), start(size.size(), 0);
  start[0] = hsize_t(first);
  size[0] = hsize_t(count);
  file.checked(H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, size.data(), nullptr));
  return {Handle(file.checked(H5Screate_simple(int(size.size()), size.data(), nullptr)), H5Sclose), std::move(space)};
}

}  // namespace

void append_rows(File& file, hid_t dataset, hid_t memory_type, Index first, Index count, const void* values) {
  file.require_whole();
  set_rows(file, dataset, first + count);
  const auto [memory, space] = part_of(file, dataset, first, count);
  file.checked(H5Dwrite(dataset, memory_type, memory, space, H5P_DEFAULT, values));
}

void read_rows(File& file, hid_t dataset, hid_t memory_type, Index first, Index count, void* values) {
  const auto [memory, space] = part_of(file, dataset, first, count);
  file.checked(H5Dread(dataset, memory_type, memory, space, H5P_DEFAULT, values));
}

void read_all(File& file, hid_t dataset, hid_t memory_type, void* values) {
  file.checked(H5Dread(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values));
}

Index rows_per_chunk(Index width) {
  return std::clamp(values_per_chunk / std::max<Index>(width, 1), fewest_rows_per_chunk, most_rows_per_chunk);
}

Index rows_per_flush(Index width) {
  const Index rows = std::max<Index>(values_per_flush / std::max<Index>(width, 1), 1), chunk = rows_per_chunk(width);
  return std::max<Index>(rows / chunk, 1) * chunk;
}

}  // namespace bromwich::hdf5
