#include "kernels/cudss.hpp"

#include "core/base/error.hpp"

#include <dlfcn.h>

#include <cstdlib>

namespace bromwich::cuda {

namespace {

constexpr int version = 1;
constexpr const char* usual_names[] = {"libcudss.so.1", "libcudss.so"};

std::string reason() {
  const char* found = dlerror();
  return found ? found : "dlopen gives no reason";
}

template <class Function>
bool find(void* library, const char* name, Function& function, std::string& missing) {
  function = reinterpret_cast<Function>(dlsym(library, name));
  if (!function && missing.empty()) missing = name;
  return function;
}

// The first function that is not there, or "".
std::string find_all(void* library, Cudss& f) {
  std::string missing;
  find(library, "cudssGetProperty", f.GetProperty, missing);
  find(library, "cudssCreate", f.Create, missing);
  find(library, "cudssDestroy", f.Destroy, missing);
  find(library, "cudssSetStream", f.SetStream, missing);
  find(library, "cudssSetThreadingLayer", f.SetThreadingLayer, missing);
  find(library, "cudssConfigCreate", f.ConfigCreate, missing);
  find(library, "cudssConfigDestroy", f.ConfigDestroy, missing);
  find(library, "cudssConfigSet", f.ConfigSet, missing);
  find(library, "cudssConfigGet", f.ConfigGet, missing);
  find(library, "cudssDataCreate", f.DataCreate, missing);
  find(library, "cudssDataDestroy", f.DataDestroy, missing);
  find(library, "cudssDataSet", f.DataSet, missing);
  find(library, "cudssDataGet", f.DataGet, missing);
  find(library, "cudssExecute", f.Execute, missing);
  find(library, "cudssMatrixCreateCsr", f.MatrixCreateCsr, missing);
  find(library, "cudssMatrixCreateDn", f.MatrixCreateDn, missing);
  find(library, "cudssMatrixSetValues", f.MatrixSetValues, missing);
  find(library, "cudssMatrixDestroy", f.MatrixDestroy, missing);
  return missing;
}

// Beside the library, or where the loader finds it. It stays open: the library would close OpenMP under its threads.
std::string threading_layer(const std::string& file) {
  const std::string name = "libcudss_mtlayer_gomp.so.1", folder = file.substr(0, file.rfind('/') + 1);
  for (const std::string& place : {folder + name, name})
    if (dlopen(place.c_str(), RTLD_NOW | RTLD_LOCAL)) return place;
  return "";
}

}  // namespace

LoadedCudss load_cudss(const std::string& file) {
  static Cudss functions;  // of the library that was loaded last
  void* library = nullptr;
  std::string name = file, why;
  if (!file.empty()) {
    library = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library) why = reason();
  }
  for (const char* usual : usual_names) {
    if (!file.empty() || library) break;
    name = usual;
    library = dlopen(usual, RTLD_NOW | RTLD_LOCAL);
    if (!library && why.empty()) why = reason();
  }
  if (!library) return {nullptr, "cuDSS cannot be loaded: " + why, ""};
  Cudss found{};
  if (const std::string missing = find_all(library, found); !missing.empty())
    return {nullptr, name + " is no cuDSS: it has no " + missing, ""};
  int major = 0;
  found.GetProperty(0, &major);
  if (major != version)
    return {nullptr, name + " is cuDSS " + std::to_string(major) + ", not " + std::to_string(version), ""};
  functions = found;
  return {&functions, "", threading_layer(name)};
}

const LoadedCudss& cudss() {
  static const LoadedCudss loaded = [] {
    const char* set = std::getenv("BROMWICH_CUDSS");
    if (!set || !*set) return LoadedCudss{nullptr, "BROMWICH_CUDSS is not set", ""};
    const std::string file = set;
    LoadedCudss found = load_cudss(file == "auto" ? "" : file);
    if (!found.functions)
      throw Error(
          "BROMWICH_CUDSS", found.missing,
          "name the file libcudss.so.1 of nvidia-cudss for this CUDA version, or unset it: the host solves then",
          ErrorKind::device);
    return found;
  }();
  return loaded;
}

}  // namespace bromwich::cuda
