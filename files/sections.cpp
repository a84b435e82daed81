#include "files/sections.hpp"

#include "core/base/error.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

const toml::table* find_table(const Document& document, const toml::table& root, const std::string& name) {
  const toml::node* node = root.get(name);
  if (!node) return nullptr;
  if (const toml::table* table = node->as_table()) return table;
  throw Error(fmt::format("{}:{}: {}", document.name, node->source().begin.line, name), "found " + kind(*node),
              fmt::format("write a section [{}]", name));
}

/// The tables of [[name]].
std::vector<const toml::table*> find_tables(const Document& document, const toml::table& root,
                                            const std::string& name) {
  std::vector<const toml::table*> tables;
  const toml::node* node = root.get(name);
  if (!node) return tables;
  const toml::array* list = node->as_array();
  for (std::size_t i = 0; list && i < list->size(); ++i) tables.push_back((*list)[i].as_table());
  if (!list || std::find(tables.begin(), tables.end(), nullptr) != tables.end())
    throw Error(fmt::format("{}:{}: {}", document.name, node->source().begin.line, name), "found " + kind(*node),
                fmt::format("write a section [[{}]] for each", name));
  return tables;
}

std::vector<std::string> keys_of(const toml::table* table) {
  std::vector<std::string> keys;
  if (table)
    for (const auto& [key, node] : *table) keys.emplace_back(key.str());
  return keys;
}

}  // namespace

const std::vector<SectionKeys>& scene_file_keys() {
  static const std::vector<SectionKeys> keys{
      {"",
       {"name",  "description", "include",  "parameters", "definitions", "dynamics",  "kronecker", "complementarity",
        "relay", "port",        "boundary", "free",       "time",        "names",     "units",     "output",
        "exact", "reference",   "quantity", "sweep",      "nonlinear",   "structure", "contact",   "memory"}},
      {"parameters", {}},
      {"definitions", {}},
      {"dynamics", {"A", "B", "E", "f", "F", "x0"}},
      {"kronecker",
       {"dimensions", "points", "spacing", "length", "diffusivity", "advection", "reaction", "along", "beside",
        "across", "b", "n", "far_b", "far_n"}},
      {"complementarity", {"N", "M", "g", "class", "restitution"}},
      {"relay", {"C", "e", "bound"}},
      {"port", {"E", "J", "R", "Q", "B", "u", "jumps", "x0"}},
      {"boundary", {"E0", "ET", "b"}},
      {"free", {"rows"}},
      {"time", {"T", "steps", "tol", "tolerance", "jumps"}},
      {"names", {"x", "y", "w"}},
      {"units", {"t", "x", "y", "w"}},
      {"output", {"states"}},
      {"exact", {"x", "y"}},
      {"reference", {"t", "x", "y", "status", "infeasible_at", "tolerance", "source"}},
      {"quantity", {"name", "W", "c", "end_W", "end_c", "exact"}},
      {"sweep", {}},
      {"nonlinear", {"phi", "gamma", "of"}},
      {"structure", {"M", "C", "K", "f", "q0", "v0", "periodic", "names", "B"}},
      {"contact", {"name", "normal", "tangent", "gap", "velocity", "mu", "restitution", "kn", "kt", "bound", "facets"}},
      {"memory", {"name", "start", "modes"}}};
  return keys;
}

Sections read_sections(const Document& document, const toml::table& root) {
  const auto keys = [](const std::string& name) -> const std::vector<std::string>& {
    const auto& all = scene_file_keys();
    return std::find_if(all.begin(), all.end(), [&](const SectionKeys& s) { return s.name == name; })->keys;
  };
  const auto section = [&](const std::string& name) {
    const toml::table* table = name.empty() ? &root : find_table(document, root, name);
    return Section(document, table, name, keys(name).empty() ? keys_of(table) : keys(name));
  };
  const auto each = [&](const std::string& name) {
    std::vector<Section> all;
    for (const toml::table* table : find_tables(document, root, name))
      all.emplace_back(document, table, fmt::format("{}[{}]", name, all.size()), keys(name));
    return all;
  };
  return {section(""),          section("parameters"), section("definitions"),
          section("dynamics"),  section("kronecker"),  section("complementarity"),
          section("relay"),     section("port"),       section("boundary"),
          section("free"),      section("time"),       section("names"),
          section("units"),     section("output"),     section("exact"),
          section("reference"), section("quantity"),   section("sweep"),
          section("nonlinear"), section("structure"),  each("contact"),
          each("memory")};
}

void read_parameters(Document& document, const Section& section, const ParameterValues& settings,
                     ParameterValues& others) {
  const std::vector<std::string>& keys = document.order["parameters"];
  std::vector<std::string> known = keys;
  for (const char* key : {"T", "steps"})
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) known.emplace_back(key);
  for (const auto& [key, value] : settings) {
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw Error("--set", fmt::format("'{}' is no parameter of {}", key, document.name) + suggestion(key, known),
                  "use one of " + join(known));
    if (!std::isfinite(value)) throw Error("--set", fmt::format("{} is {}", key, value), "give a finite number");
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) others.emplace(key, value);
  }
  for (const std::string& key : keys) {
    const double written = settings.contains(key) ? settings.at(key) : section.number(key);
    document.expressions.define(key, written, section.where(key));
  }
}

void read_definitions(Document& document, const Section& section) {
  for (const std::string& key : document.order["definitions"])
    document.expressions.define_in_time(key, section.expression(key), section.where(key));
}

void in_the_file(const std::function<Places()>& places_of_members, const std::function<void()>& check) {
  try {
    check();
  } catch (const Error& error) {
    const Places places = places_of_members();
    const std::string& argument = error.argument();
    for (const auto& [member, place] : places)  // it already names a place; the file may have the name of a member
      if (place.find(':') != std::string::npos && argument.starts_with(place.substr(0, place.find(':') + 1))) throw;
    const auto whole = places.find(argument);
    const auto place = whole != places.end() ? whole : places.find(argument.substr(0, argument.find_first_of(".(")));
    if (place == places.end()) throw;
    throw Error(place->second, error.found(), error.remedy(), error.kind());
  }
}

Places places(const Sections& s) {
  const bool relays_alone = s.relay.given() && !s.complementarity.given();
  const bool sum = s.kronecker.given();
  return {{"A", s.dynamics.where("A")},
          {"B", s.dynamics.where("B")},
          {"along", s.kronecker.where("points")},
          {"across", s.kronecker.where("points")},
          {"beside", s.kronecker.where("points")},
          {"n", s.kronecker.where("n")},
          {"e", s.relay.where("e")},
          {"E", s.dynamics.where("E")},
          {"F", s.dynamics.where("F")},
          {"f", s.dynamics.where("f")},
          {"x0", s.dynamics.where("x0")},
          {"C", s.relay.where("C")},
          {"N", relays_alone ? s.relay.where("C") : s.complementarity.where("N")},
          {"M", s.complementarity.where("M")},
          {"g", relays_alone ? s.relay.where("e") : s.complementarity.where("g")},
          {"lcp_class", s.complementarity.where("class")},
          {"restitution", s.complementarity.where("restitution")},
          {"E0", s.boundary.where("E0")},
          {"ET", s.boundary.where("ET")},
          {"b", sum ? s.kronecker.where("b") : s.boundary.where("b")},
          {"free_rows", s.free.where("rows")},
          {"T", s.time.where("T")},
          {"breakpoints", s.time.where("jumps")},
          {"default_steps", s.time.where("steps")}};
}

}  // namespace bromwich
