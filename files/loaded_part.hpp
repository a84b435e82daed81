#pragma once
// Parts of the command in shared objects of their own, loaded when they are needed: the libraries of HDF5 and of MPI
// bring dozens of others, whose loading takes longer than a small solve. Objects and exceptions pass between both
// sides, so both have to be of one build. cmake/BromwichPart.cmake makes them.

#include <string>

namespace bromwich {

/// Version, compiler and layout; equal on both sides.
std::string part_abi();

/// A shared object has the function `bromwich_part`: its table of functions if `abi` is its own, otherwise null.
inline constexpr const char* part_symbol = "bromwich_part";
using PartEntry = const void* (*)(const char* abi);

struct LoadedPart {
  const void* functions = nullptr;  ///< the table of the part
  std::string missing;              ///< why there is none, in one line
};

/// Whether what the part links with is seen by libraries that are loaded later.
enum class PartLibraries { hidden, seen };

/// The part bromwich_NAME.so beside the program, or where it is installed. It stays loaded.
LoadedPart load_part(const std::string& name, PartLibraries = PartLibraries::hidden);

}  // namespace bromwich
