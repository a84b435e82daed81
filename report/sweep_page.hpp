#pragma once
// A page on the table of a sweep: every column of numbers over one swept parameter, or as a map over two.

#include <filesystem>
#include <string>

namespace bromwich::report {

/// Whether it is a table that `solve` of a scene with [sweep] has written.
bool is_sweep_table(const std::filesystem::path&);

/// The page. Throws Error(argument, ...) where the table is damaged.
std::string sweep_page(const std::string& argument, const std::filesystem::path&, const std::string& version);

}  // namespace bromwich::report
