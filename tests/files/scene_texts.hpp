#pragma once
// Texts of scene files, and what reading them gives.

#include "files/scene_file.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace bromwich {

inline const std::string two_states =
    "[dynamics]\nA = [[-2, 1], [1, -2]]\nB = [[1], [0]]\nx0 = [1, 0]\n[complementarity]\nN = [[1, 0]]\nM = [[1]]\n"
    "[time]\nT = 1\n";

inline std::string with_replaced(std::string text, const std::string& from, const std::string& to) {
  text.replace(text.find(from), from.size(), to);
  return text;
}

inline SceneFile parse_sections(const std::string& text, const ParameterValues& settings = {}) {
  return parse_scene(text, "my.toml", {}, settings);
}

inline std::string refused_section(const std::string& text) {
  return refusal([&] { parse_sections(text); });
}

inline void expect_refused_sections(const std::vector<Refused>& cases) {
  for (const Refused& bad : cases) {
    const std::string found = refused_section(bad.text);
    EXPECT_TRUE(found.starts_with(bad.message)) << found << "\nexpected: " << bad.message;
    EXPECT_NE(found.find("; "), std::string::npos) << found;  // what to do
  }
}

inline const DenseDynamics& dense_matrices(const SceneFile& file) { return get<DenseDynamics>(file.scene.dynamics); }

}  // namespace bromwich
