#pragma once
// Reads HDF5 files with the C interface alone, to compare with what was written.

#include "core/base/types.hpp"

#include <gtest/gtest.h>

#include <hdf5.h>

#include <filesystem>
#include <string>
#include <vector>

namespace bromwich {

class Hdf5Reading {
 public:
  explicit Hdf5Reading(const std::filesystem::path& path) {
    const hid_t properties = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_file_locking(properties, false, true);  // as the writer, which may be in the same process
    file_ = H5Fopen(path.c_str(), H5F_ACC_RDONLY, properties);
    H5Pclose(properties);
    EXPECT_GE(file_, 0) << path;
  }
  ~Hdf5Reading() { H5Fclose(file_); }
  Hdf5Reading(const Hdf5Reading&) = delete;
  Hdf5Reading& operator=(const Hdf5Reading&) = delete;

  bool readable() const { return file_ >= 0; }
  bool has(const std::string& name) const { return H5Lexists(file_, name.c_str(), H5P_DEFAULT) > 0; }

  std::vector<hsize_t> shape(const std::string& name) const {
    const hid_t data = H5Dopen2(file_, name.c_str(), H5P_DEFAULT), space = H5Dget_space(data);
    std::vector<hsize_t> found(std::size_t(std::max(0, H5Sget_simple_extent_ndims(space))));
    H5Sget_simple_extent_dims(space, found.data(), nullptr);
    H5Sclose(space);
    H5Dclose(data);
    return found;
  }

  /// Rows of a dataset with all further dimensions in one.
  RowMatrix rows(const std::string& name) const {
    const std::vector<hsize_t> found = shape(name);
    Index width = 1;
    for (std::size_t i = 1; i < found.size(); ++i) width *= Index(found[i]);
    RowMatrix values(found.empty() ? 0 : Index(found[0]), width);
    const hid_t data = H5Dopen2(file_, name.c_str(), H5P_DEFAULT);
    EXPECT_GE(H5Dread(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0) << name;
    H5Dclose(data);
    return values;
  }

  std::string text(const std::string& attribute) const {
    if (H5Aexists(file_, attribute.c_str()) <= 0) return "(none)";
    const hid_t found = H5Aopen(file_, attribute.c_str(), H5P_DEFAULT), type = H5Aget_type(found);
    char* bytes = nullptr;
    EXPECT_GE(H5Aread(found, type, static_cast<void*>(&bytes)), 0) << attribute;
    const std::string value = bytes ? bytes : "";
    H5free_memory(bytes);
    H5Tclose(type);
    H5Aclose(found);
    return value;
  }

  double number(const std::string& object, const std::string& attribute) const {
    double value = -1;
    const hid_t found = H5Aopen_by_name(file_, object.c_str(), attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT);
    EXPECT_GE(H5Aread(found, H5T_NATIVE_DOUBLE, &value), 0) << attribute;
    H5Aclose(found);
    return value;
  }

 private:
  hid_t file_;
};

}  // namespace bromwich
