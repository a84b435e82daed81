// Sources f and g: functions of the caller, expressions, tables.

#include "capi/arrays.hpp"
#include "capi/failures.hpp"
#include "capi/handles.hpp"
#include "files/expression.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace bromwich::capi {

namespace {

/// Takes f or g and its kinks.
void set_source(bromwich_scene& s, const std::string& name, GivenSource source) {
  if (name != "f" && name != "g") throw Error("name", fmt::format("found '{}'", name), "use f or g");
  if (s.circuit) throw Error(name, "is set in the scene of a netlist", "write it as a source of the netlist");
  (name == "f" ? s.scene.f : s.scene.g) = source.function;
  (name == "f" ? s.f : s.g) = std::move(source);
  merge_kinks(s);
}

Index width_of(const bromwich_scene& s, const std::string& name, Index found, const char* unit) {
  const Index wanted = name == "f" ? s.scene.sources() : s.scene.constraints();
  if (found != wanted) throw Error(name, fmt::format("has {} {}", found, unit), fmt::format("give {}", wanted));
  return wanted;
}

/// Rows at times, linear between them.
GivenSource table(const std::string& name, const Vector& times, const Matrix& values, double T) {
  const Index rows = times.size();
  if (rows < 2 || !times.allFinite() || !std::is_sorted(times.begin(), times.end()))
    throw Error(name, fmt::format("has {} times", rows), "give two or more, finite and not decreasing");
  if (times[0] > 0 || times[rows - 1] < T)
    throw Error(name, fmt::format("has times from {:g} to {:g}", times[0], times[rows - 1]),
                fmt::format("cover 0 to {:g}", T));
  GivenSource source;
  for (Index i = 1; i + 1 < rows; ++i)
    if (times[i] > times[i - 1] && times[i] > 0 && times[i] < T) source.kinks.push_back(times[i]);
  source.function = [times, values](double t, Eigen::Ref<Vector> out) {
    const Index above = std::upper_bound(times.begin(), times.end(), t) - times.begin();  // of two rows the second one
    if (above == 0 || above == times.size()) {
      out = values.row(std::min(above, times.size() - 1)).transpose();
      return;
    }
    const double share = (t - times[above - 1]) / (times[above] - times[above - 1]);
    out = ((1 - share) * values.row(above - 1) + share * values.row(above)).transpose();
  };
  return source;
}

/// Kinks and jumps are found in the texts.
GivenSource expressions_of(const std::vector<std::string>& texts, const std::string& name, double T) {
  const Expressions expressions;
  std::vector<std::string> full;
  for (const std::string& text : texts) full.push_back(expressions.in_full(text, name));
  SwitchTimes found = expressions.switch_times(full, T);
  return {expressions.in_time(full), std::move(found.times), found.complete};
}

}  // namespace

}  // namespace bromwich::capi

using namespace bromwich;
using namespace bromwich::capi;

int bromwich_scene_set_function(bromwich_scene* scene, const char* name, bromwich_function function, void* user) {
  return guarded([&] {
    const std::string named = &given(name, "name");
    if (!function) throw Error("function", "is NULL", "give a function");
    GivenSource source;
    source.all = false;
    source.function = [function, user, named](double t, Eigen::Ref<Vector> values) {
      if (const int code = function(t, values.data(), user); code != 0)
        throw Stopped(fmt::format("{}: the function returned {} at t = {}; return 0 to go on", named, code, t));
    };
    set_source(given(scene, "scene"), named, std::move(source));
  });
}

int bromwich_scene_set_expressions(bromwich_scene* scene, const char* name, const char* const* texts, int64_t count) {
  return guarded([&] {
    bromwich_scene& changed = given(scene, "scene");
    const std::string named = &given(name, "name");
    given_array(texts, width_of(changed, named, count, "expressions"), "texts");
    std::vector<std::string> words;
    for (int64_t i = 0; i < count; ++i) words.emplace_back(&given(texts[i], "texts"));
    set_source(changed, named, expressions_of(words, named, changed.scene.T));
  });
}

int bromwich_scene_set_table(bromwich_scene* scene, const char* name, const double* times, int64_t rows,
                             const double* values, int64_t columns, int order) {
  return guarded([&] {
    bromwich_scene& changed = given(scene, "scene");
    const std::string named = &given(name, "name");
    width_of(changed, named, columns, "columns");
    const Vector at = Eigen::Map<const Vector>(given_array(times, rows, "times"), rows);
    set_source(changed, named, table(named, at, matrix_from(values, rows, columns, order, named), changed.scene.T));
  });
}
