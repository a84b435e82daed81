#include "files/loaded_part.hpp"

#include <dlfcn.h>

#include <filesystem>
#include <system_error>

namespace bromwich {

namespace {

namespace fs = std::filesystem;

/// Where the part is: in the folder of the program, or BROMWICH_PARTS from there (installed).
fs::path file_of(const std::string& name) {
  std::error_code unknown;
  const fs::path folder = fs::read_symlink("/proc/self/exe", unknown).parent_path();
  const fs::path beside = folder / ("bromwich_" + name + ".so");
  return fs::exists(beside, unknown) ? beside : (folder / BROMWICH_PARTS / beside.filename()).lexically_normal();
}

std::string reason() {
  const char* found = dlerror();
  return found ? found : "dlopen gives no reason";
}

}  // namespace

LoadedPart load_part(const std::string& name, PartLibraries libraries) {
  const fs::path file = file_of(name);
  void* part = dlopen(file.c_str(), RTLD_NOW | (libraries == PartLibraries::seen ? RTLD_GLOBAL : RTLD_LOCAL));
  if (!part) return {nullptr, "a part of this program cannot be loaded: " + reason()};
  const auto entry = reinterpret_cast<PartEntry>(dlsym(part, part_symbol));
  const void* functions = entry ? entry(part_abi().c_str()) : nullptr;
  if (!functions) return {nullptr, "'" + file.string() + "' is of another build"};
  return {functions, ""};
}

}  // namespace bromwich
