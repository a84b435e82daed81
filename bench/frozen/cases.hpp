#pragma once
// What `bromwich_frozen` solves: files of examples/, the hard cases of `bromwich bench stability`, random scenes on
// given grids, and random scenes with sources, to a tolerance and on given grids.

#include "core/result/result.hpp"
#include "core/seam/backend.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace bromwich::frozen {

struct Case {
  std::string name;  ///< "set/scene/options", the same in every build
  std::function<Result(Backend&, std::function<bool()> interrupted)> solve;  ///< with all states
};

struct Selection {
  std::filesystem::path examples;
  std::uint32_t random = 10000;  ///< scenes of tests/support/random_scenes.hpp, each by four methods
  std::uint32_t sources = 1134;  ///< scenes of tests/support/random_sources.hpp, each in three ways
  bool hard = true;
};

std::vector<Case> cases(const Selection&);

}  // namespace bromwich::frozen
