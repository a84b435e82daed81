#pragma once
// include = ["common.toml", ...] at the top of a scene file: the keys of other files, which keys of the file replace.

#include "files/section.hpp"

#include <string>

namespace bromwich {

/// The table of a scene file with the keys of the files that it includes, later ones before earlier ones. Notes in the
/// document the folders of the files, the files read, and the order of keys. Throws Error for text that is not TOML,
/// and for a file that includes itself.
toml::table read_with_includes(Document& document, std::string_view toml, const std::filesystem::path& path);

}  // namespace bromwich
