#include "core/result/method.hpp"

#include "core/base/error.hpp"

#include <array>
#include <utility>

namespace bromwich {

namespace {

constexpr std::array<std::pair<Method, const char*>, 11> method_names{{
    {Method::automatic, "auto"},
    {Method::multigrid, "multigrid"},
    {Method::dual, "dual"},
    {Method::contour, "contour"},
    {Method::contour_literal, "contour-literal"},
    {Method::march, "march"},
    {Method::euler, "euler"},
    {Method::events, "events"},
    {Method::shooting, "shooting"},
    {Method::galerkin, "galerkin"},
    {Method::goal, "goal"},
}};

}  // namespace

const char* to_string(Method method) {
  for (const auto& [value, name] : method_names)
    if (value == method) return name;
  return "unknown";
}

Method method_from_string(const std::string& name) {
  std::string known;
  for (const auto& [value, text] : method_names) {
    if (name == text) return value;
    known += std::string(known.empty() ? "" : ", ") + text;
  }
  throw Error("method", "found '" + name + "'", "use one of " + known);
}

bool iterates(Method method) {
  return method == Method::multigrid || method == Method::dual || method == Method::contour ||
         method == Method::contour_literal;
}

bool locates_switches(Method method) { return method == Method::events || method == Method::shooting; }

}  // namespace bromwich
