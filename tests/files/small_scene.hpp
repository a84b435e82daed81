#pragma once
// A scene file of one state and one constraint, of which tests replace lines.

#include "files/scene_file.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace bromwich::scene_file_test {

/// One state, one constraint; tests replace single lines. Lines count from 1.
inline const std::vector<std::string> small_scene{
    "[parameters]",       // 1
    "R = 2",              // 2
    "C = \"1/(2*R)\"",    // 3
    "[dynamics]",         // 4
    "A = [[\"-1/C\"]]",   // 5
    "B = [[1]]",          // 6
    "x0 = [3]",           // 7
    "[complementarity]",  // 8
    "N = [[1]]",          // 9
    "M = [[\"R\"]]",      // 10
    "[time]",             // 11
    "T = 2",              // 12
};

inline std::string lines(const std::vector<std::string>& all) {
  std::string text;
  for (const std::string& line : all) text += line + "\n";
  return text;
}

/// small_scene with line `number` (from 1) replaced; 0 appends.
inline std::string with(std::size_t number, const std::string& line) {
  auto all = small_scene;
  if (number > 0)
    all[number - 1] = line;
  else
    all.push_back(line);
  return lines(all);
}

inline SceneFile parse(const std::string& text, const ParameterValues& settings = {}) {
  return parse_scene(text, "my.toml", {}, settings);
}

inline const DenseDynamics& dense(const SceneFile& file) { return get<DenseDynamics>(file.scene.dynamics); }

inline const std::string toy_port =
    "[port]\n"                                   // 1
    "J = [[0, 0, 1], [0, 0, -1], [-1, 1, 0]]\n"  // 2
    "R = [[1, 1, 0], [1, 1, 0], [0, 0, 0]]\n"    // 3
    "B = [[1], [1], [0]]\n"                      // 4
    "u = [\"t > 5 ? 10 : 0\"]\n"                 // 5
    "x0 = [1, 2, 1]\n"                           // 6
    "[time]\nT = 10\nsteps = 200\n";             // 7 to 9

}  // namespace bromwich::scene_file_test
