// A checkpoint is a small HDF5 file: datasets x and y, attributes for the rest.

#include "files/checkpoint.hpp"

#include "core/base/error.hpp"
#include "files/hdf5_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace bromwich {

using namespace hdf5;

namespace {

constexpr const char* format = "bromwich-checkpoint/1";

void write_vector(File& file, const std::string& name, const Vector& values) {
  fixed_dataset(file, file, name, H5T_NATIVE_DOUBLE, {hsize_t(values.size())}, values.data());
}

Vector read_vector(File& file, const std::string& name) {
  const Handle dataset = open_dataset(file, file, name);
  const Shape shape = shape_of(file, dataset);
  Vector values(shape.size() == 1 ? Index(shape[0]) : 0);
  if (values.size() > 0) read_all(file, dataset, H5T_NATIVE_DOUBLE, values.data());
  return values;
}

template <typename Value>
Value number_attribute(File& file, const std::string& name, hid_t memory) {
  const Handle attribute(file.checked(H5Aopen(file, name.c_str(), H5P_DEFAULT)), H5Aclose);
  const Handle space(file.checked(H5Aget_space(attribute)), H5Sclose);
  if (H5Sget_simple_extent_npoints(space) != 1)
    throw Error(file.target().argument, "'" + file.target().path.string() + "' is damaged at " + name,
                "start without --restart");
  Value value{};
  file.checked(H5Aread(attribute, memory, &value));
  return value;
}

/// Numbers that name `prefix` + something.
herr_t collect_fact(hid_t object, const char* name, const H5A_info_t* /*info*/, void* into) {
  const std::string prefix = "total_", word = name;
  if (!word.starts_with(prefix)) return 0;
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  double value = 0;
  if (attribute < 0 || H5Aread(attribute, H5T_NATIVE_DOUBLE, &value) < 0) return -1;
  static_cast<Facts*>(into)->emplace_back(word.substr(prefix.size()), value);
  return 0;
}

/// The file is on the disk, and not only in the memory of the system.
void synchronize(const FileTarget& target, const std::filesystem::path& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool done = descriptor >= 0 && ::fsync(descriptor) == 0;
  if (descriptor >= 0) ::close(descriptor);
  if (!done)
    throw Error(target.argument, "'" + path.string() + "' could not be written (" + std::strerror(errno) + ")",
                "choose another folder");
}

}  // namespace

void write_checkpoint(const FileTarget& target, const Checkpoint& checkpoint) {
  std::filesystem::path temporary = target.path;
  temporary += ".tmp";
  {
    File file({target.argument, temporary}, File::Access::create);
    set_attributes(file, file,
                   {{"format", format},
                    {"run", checkpoint.run},
                    {"scene", checkpoint.scene},
                    {"row", std::int64_t(checkpoint.row)},
                    {"steps", std::int64_t(checkpoint.steps)},
                    {"t", checkpoint.t}});
    for (const auto& [name, fact] : checkpoint.totals) set_attributes(file, file, {{"total_" + name, fact}});
    write_vector(file, "x", checkpoint.x);
    write_vector(file, "y", checkpoint.y);
    file.close();
  }
  synchronize(target, temporary);
  if (::rename(temporary.c_str(), target.path.c_str()) != 0)
    throw Error(target.argument, "'" + target.path.string() + "' could not be written (" + std::strerror(errno) + ")",
                "choose another file");
}

Checkpoint read_checkpoint(const FileTarget& target) {
  File file(target, File::Access::read);
  if (text_attribute(file, file, "format") != format)
    throw Error(target.argument, "'" + target.path.string() + "' is no checkpoint of this version",
                "give a file that --checkpoint has written");
  Checkpoint found;
  found.run = text_attribute(file, file, "run");
  found.scene = text_attribute(file, file, "scene");
  found.row = number_attribute<std::int64_t>(file, "row", H5T_NATIVE_INT64);
  found.steps = number_attribute<std::int64_t>(file, "steps", H5T_NATIVE_INT64);
  found.t = number_attribute<double>(file, "t", H5T_NATIVE_DOUBLE);
  found.x = read_vector(file, "x");
  found.y = read_vector(file, "y");
  hsize_t first = 0;
  file.checked(H5Aiterate2(file, H5_INDEX_NAME, H5_ITER_INC, &first, collect_fact, &found.totals));
  return found;
}

}  // namespace bromwich
