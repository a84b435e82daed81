#pragma once
// cuDSS, NVIDIA's direct solver for sparse matrices (the package nvidia-cudss-cu13), loaded where it is installed. What
// is declared here is the part of version 1 that the backend uses; its types are opaque.

#include <cstddef>
#include <cstdint>
#include <string>

namespace bromwich::cuda {

/// Functions of the library by their names without `cudss`; they return 0 or a status.
struct Cudss {
  int (*GetProperty)(int which, int* value);
  int (*Create)(void** handle);
  int (*Destroy)(void* handle);
  int (*SetStream)(void* handle, void* stream);
  int (*SetThreadingLayer)(void* handle, const char* file);
  int (*ConfigCreate)(void** config);
  int (*ConfigDestroy)(void* config);
  int (*ConfigSet)(void* config, int which, const void* value, std::size_t bytes);
  int (*ConfigGet)(void* config, int which, void* value, std::size_t bytes, std::size_t* written);
  int (*DataCreate)(void* handle, void** data);
  int (*DataDestroy)(void* handle, void* data);
  int (*DataSet)(void* handle, void* data, int which, const void* value, std::size_t bytes);
  int (*DataGet)(void* handle, void* data, int which, void* value, std::size_t bytes, std::size_t* written);
  int (*Execute)(void* handle, int phase, void* config, void* data, void* matrix, void* solution, void* right);
  int (*MatrixCreateCsr)(void** matrix, std::int64_t rows, std::int64_t cols, std::int64_t entries, const void* begin,
                         const void* end, const void* columns, const void* values, int offset_type, int index_type,
                         int value_type, int kind, int view, int base);
  int (*MatrixCreateDn)(void** matrix, std::int64_t rows, std::int64_t cols, std::int64_t stride, const void* values,
                        int value_type, int layout);
  int (*MatrixSetValues)(void* matrix, const void* values);
  int (*MatrixDestroy)(void* matrix);

  // Values of its enumerations, version 1.
  static constexpr int config_matching = 3, config_host_threads = 14, config_levels = 17, config_schur = 23;
  static constexpr int data_order = 4, data_user_order = 9, data_schur_rows = 18, data_schur_matrix = 20,
                       data_user_tree = 21, data_tree = 22;
  static constexpr int analyse = 3, factorize = 4, factorize_again = 8;
  static constexpr int general = 0, full = 0, from_zero = 0, column_major = 0;
};

struct LoadedCudss {
  const Cudss* functions = nullptr;  ///< null: not there, or not usable
  std::string missing;               ///< why
  std::string threads;               ///< file of its layer for threads of the host, "" where there is none
};

/// The library `file`, or, if that is empty, the one that the loader finds by its usual names. Never closed.
LoadedCudss load_cudss(const std::string& file);

/// That of the environment variable BROMWICH_CUDSS, a file, or `auto` for the usual names; loaded by the first call.
/// None if the variable is not set: it has not been shown that the library is faster than the cores of a host. Throws
/// Error if it is set and the library cannot be used.
const LoadedCudss& cudss();

}  // namespace bromwich::cuda
