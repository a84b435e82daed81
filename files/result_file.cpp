#include "files/result_file.hpp"

namespace bromwich {

std::vector<std::string> constraint_names(const ResultColumns& columns) {
  if (!columns.constraint_names.empty()) return columns.constraint_names;
  std::vector<std::string> names;
  for (Index i = 0; i < columns.constraints; ++i) names.push_back("y" + std::to_string(i));
  return names;
}

std::vector<std::string> state_names(const ResultColumns& columns) {
  if (!columns.state_names.empty()) return columns.state_names;
  std::vector<std::string> names;
  for (const Index component : columns.states) names.push_back("x" + std::to_string(component));
  return names;
}

}  // namespace bromwich
