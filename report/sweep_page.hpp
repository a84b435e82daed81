#pragma once
// A page on the table of a sweep: every column of numbers over one swept parameter, or as a map over two.

#include "files/sweep_file.hpp"

#include <filesystem>
#include <optional>
#include <string>

namespace bromwich::report {

/// What `solve` of a scene with [sweep] has written, .csv or .h5; nothing for another file. Throws Error(argument, ...)
/// where it is damaged.
std::optional<StoredSweep> read_sweep_table(const std::string& argument, const std::filesystem::path&);

/// The page; `name` is that of the file.
std::string sweep_page(const StoredSweep&, const std::string& name, const std::string& version);

}  // namespace bromwich::report
