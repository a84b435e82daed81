// The published schema of scene files beside the keys of the reader.

#include "files/scene_file_keys.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <filesystem>
#include <fstream>
#include <set>
#include <string>

namespace bromwich {
namespace {

TEST(SceneSchema, HasTheKeysOfTheReader) {
  std::ifstream file(std::filesystem::path(BROMWICH_EXAMPLES).parent_path() / "docs" / "scene.schema.json");
  const nlohmann::json schema = nlohmann::json::parse(file), &sections = schema.at("properties");
  const auto keys_of = [](const nlohmann::json& object) {
    std::set<std::string> keys;
    for (const auto& [key, value] : object.items()) keys.insert(key);
    return keys;
  };
  for (const SectionKeys& section : scene_file_keys()) {
    const std::set<std::string> keys(section.keys.begin(), section.keys.end());
    const bool many = sections.contains(section.name) && sections.at(section.name).contains("items");  // [[contact]]
    if (section.name.empty()) {
      EXPECT_EQ(keys_of(sections), keys);
      EXPECT_EQ(schema.at("additionalProperties"), false);
    } else if (keys.empty()) {  // any key, with values of one kind
      EXPECT_TRUE(sections.at(section.name).at("additionalProperties").is_object()) << section.name;
    } else {
      const nlohmann::json& table = many ? sections.at(section.name).at("items") : sections.at(section.name);
      EXPECT_EQ(keys_of(table.at("properties")), keys) << section.name;
      EXPECT_EQ(table.at("additionalProperties"), false) << section.name;
    }
  }
}

}  // namespace
}  // namespace bromwich
