// Scene files of TOML.

#include "files/scene_file.hpp"
#include "tests/fuzz/read.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return bromwich::fuzz::accepts(
      [&] { bromwich::parse_scene(bromwich::fuzz::text(data, size), "fuzz.toml", "/nonexistent"); });
}
