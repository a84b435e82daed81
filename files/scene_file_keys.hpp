#pragma once

#include <string>
#include <vector>

namespace bromwich {

/// The known keys of a section; the first section, without a name, is the top of a file.
struct SectionKeys {
  std::string name;
  std::vector<std::string> keys;  ///< empty: any
};
/// Of all sections. docs/scene.schema.json has the same.
const std::vector<SectionKeys>& scene_file_keys();

}  // namespace bromwich
