#pragma once
// The sections of a scene file, and how an Error about a scene finds its line.

#include "files/scene_file.hpp"
#include "files/section.hpp"

#include <functional>
#include <map>
#include <string>

namespace bromwich {

/// The sections of a file, by name.
struct Sections {
  Section top, parameters, dynamics, complementarity, relay, port, boundary, free, time, output, exact, reference,
      quantity;
};

/// Throws Error for a section or a key that is not known.
Sections read_sections(const Document&, const toml::table& root);

/// Defines the parameters of the file for its expressions, in its order; `settings` replace values.
void read_parameters(Document&, const toml::table& root, const Section&, const ParameterValues& settings);

/// The places in the file of the members of Scene.
std::map<std::string, std::string> places(const Sections&);

/// Runs `check`, whose Errors name a member of Scene, and lets them name its place in the file instead.
void in_the_file(const std::map<std::string, std::string>& places, const std::function<void()>& check);

}  // namespace bromwich
