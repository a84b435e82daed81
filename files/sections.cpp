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

std::vector<std::string> keys_of(const toml::table* table) {
  std::vector<std::string> keys;
  if (table)
    for (const auto& [key, node] : *table) keys.emplace_back(key.str());
  return keys;
}

/// The keys in the order of the file: a parameter may use those above it.
std::vector<std::string> in_file_order(const toml::table& table) {
  std::vector<std::pair<toml::source_position, std::string>> found;
  for (const auto& [key, node] : table) found.emplace_back(key.source().begin, key.str());
  std::sort(found.begin(), found.end());
  std::vector<std::string> keys;
  for (const auto& [position, key] : found) keys.push_back(key);
  return keys;
}

}  // namespace

Sections read_sections(const Document& document, const toml::table& root) {
  const auto table = [&](const char* name) { return find_table(document, root, name); };
  const Section top(document, &root, "",
                    {"name", "description", "parameters", "dynamics", "complementarity", "relay", "port", "boundary",
                     "free", "time", "output", "exact", "reference", "quantity"});
  const toml::table* parameters = table("parameters");
  return {top,
          Section(document, parameters, "parameters", keys_of(parameters)),
          Section(document, table("dynamics"), "dynamics", {"A", "B", "E", "f", "F", "x0"}),
          Section(document, table("complementarity"), "complementarity", {"N", "M", "g", "class"}),
          Section(document, table("relay"), "relay", {"C"}),
          Section(document, table("port"), "port", {"E", "J", "R", "Q", "B", "u", "jumps", "x0"}),
          Section(document, table("boundary"), "boundary", {"E0", "ET", "b"}),
          Section(document, table("free"), "free", {"rows"}),
          Section(document, table("time"), "time", {"T", "steps", "jumps"}),
          Section(document, table("output"), "output", {"states"}),
          Section(document, table("exact"), "exact", {"x", "y"}),
          Section(document, table("reference"), "reference",
                  {"t", "x", "y", "status", "infeasible_at", "tolerance", "source"}),
          Section(document, table("quantity"), "quantity", {"name", "W", "c", "end_W", "end_c", "exact"})};
}

void read_parameters(Document& document, const toml::table& root, const Section& section,
                     const ParameterValues& settings) {
  const toml::table* table = find_table(document, root, "parameters");
  const auto keys = table ? in_file_order(*table) : std::vector<std::string>{};
  for (const auto& [key, value] : settings) {
    if (std::find(keys.begin(), keys.end(), key) == keys.end())
      throw Error("--set", fmt::format("'{}' is no parameter of {}", key, document.name) + suggestion(key, keys),
                  keys.empty() ? "leave it out" : "use one of " + join(keys));
    if (!std::isfinite(value)) throw Error("--set", fmt::format("{} is {}", key, value), "give a finite number");
  }
  for (const std::string& key : keys) {
    const double written = settings.contains(key) ? settings.at(key) : section.number(key);
    document.expressions.define(key, written, section.where(key));
  }
}

void in_the_file(const std::map<std::string, std::string>& places, const std::function<void()>& check) {
  try {
    check();
  } catch (const Error& error) {
    const std::string line = error.what();
    for (const auto& [member, place] : places)  // it already names a place; the file may have the name of a member
      if (line.starts_with(place.substr(0, place.find(':') + 1))) throw;
    const std::size_t colon = std::min(line.find(": "), line.size());
    const std::size_t member = std::min(line.find_first_of(".(:"), line.size());
    const auto place = places.find(line.substr(0, member));
    const std::size_t semicolon = line.rfind("; ");
    if (place == places.end() || semicolon == std::string::npos || semicolon < colon) throw;
    throw Error(place->second, line.substr(colon + 2, semicolon - colon - 2), line.substr(semicolon + 2));
  }
}

std::map<std::string, std::string> places(const Sections& s) {
  const Section& seen = s.relay.given() ? s.relay : s.complementarity;
  return {{"A", s.dynamics.where("A")},
          {"B", s.dynamics.where("B")},
          {"E", s.dynamics.where("E")},
          {"F", s.dynamics.where("F")},
          {"f", s.dynamics.where("f")},
          {"x0", s.dynamics.where("x0")},
          {"C", s.relay.where("C")},
          {"N", seen.where(s.relay.given() ? "C" : "N")},
          {"M", s.complementarity.where("M")},
          {"g", s.complementarity.where("g")},
          {"lcp_class", s.complementarity.where("class")},
          {"E0", s.boundary.where("E0")},
          {"ET", s.boundary.where("ET")},
          {"b", s.boundary.where("b")},
          {"free_rows", s.free.where("rows")},
          {"T", s.time.where("T")},
          {"breakpoints", s.time.where("jumps")},
          {"default_steps", s.time.where("steps")}};
}

}  // namespace bromwich
