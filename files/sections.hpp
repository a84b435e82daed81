#pragma once
// The sections of a scene file, and the translation of an Error about a scene to a line of the file.

#include "files/scene_file.hpp"
#include "files/scene_file_keys.hpp"
#include "files/section.hpp"

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace bromwich {

/// The sections of a file, by name.
struct Sections {
  Section top, parameters, definitions, dynamics, kronecker, complementarity, relay, port, boundary, free, time, names,
      units, output, exact, reference, quantity, sweep, nonlinear, structure;
  std::vector<Section> contacts;  ///< of [[contact]]
  std::vector<Section> memories;  ///< of [[memory]]
};

/// Throws Error for an unknown section or key.
Sections read_sections(const Document&, const toml::table& root);

/// Defines the parameters of the file for its expressions, in the order of the file; `settings` replace values.
/// Settings of other keys stay in `others`.
void read_parameters(Document&, const Section&, const ParameterValues& settings, ParameterValues& others);

/// Defines the expressions of [definitions], in the order of the file.
void read_definitions(Document&, const Section&);

/// Places in the file, by the names of members.
using Places = std::map<std::string, std::string>;
/// Of the members of Scene.
Places places(const Sections&);

/// Runs `check`, whose Errors name a member, and replaces this name by its place in the file. `places` is called where
/// there is an Error.
void in_the_file(const std::function<Places()>& places, const std::function<void()>& check);

}  // namespace bromwich
