#include "app/parameter_columns.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace bromwich::app {

std::vector<std::string> parse_parameters(const std::string& argument, const std::string& words,
                                          const ParameterValues& parameters) {
  std::vector<std::string> known, names;
  for (const auto& [name, value] : parameters) known.push_back(name);
  for (const std::string& name : split_list(words)) {
    if (!parameters.count(name))
      throw Error(argument, fmt::format("'{}' is no parameter of the scene", name) + suggestion(name, known),
                  known.empty() ? "give the scene [parameters]" : "use some of " + join(known));
    if (std::find(names.begin(), names.end(), name) != names.end())
      throw Error(argument, fmt::format("'{}' is given twice", name), "give it once");
    names.push_back(name);
  }
  if (names.empty()) throw Error(argument, "found no name", "give parameters of the scene, such as R,C");
  return names;
}

VariedParameter scene_parameter(SceneSource& source, const ParameterValues& settings, const std::string& name,
                                double value) {
  return {name, value, [&source, settings, name](double v) {
            ParameterValues changed = settings;
            changed[name] = v;
            SceneChoice choice = source.with(changed);
            return ParameterScene{std::move(choice.scene), std::move(choice.quantity)};
          }};
}

Vector column_of(const SolutionChange& d, const Vector& t, const Scene& scene, const Column& c,
                 const std::vector<double>& at) {
  const auto value = [&](Index row) {
    switch (c.kind) {
      case ColumnKind::y:
        return d.y(row, c.component);
      case ColumnKind::w:
        return d.w(row, c.component);
      case ColumnKind::x:
        return d.x(row, c.component);
      case ColumnKind::mode:
      case ColumnKind::contact:  // not among the columns of derivatives
        return 0.0;
      case ColumnKind::trace:
        break;
    }
    return scene.dynamics->observe(d.x.row(row).transpose())[c.component];
  };
  Vector values(Index(at.size()));
  for (std::size_t k = 0; k < at.size(); ++k) {
    const Index after = Index(std::upper_bound(t.begin(), t.end(), at[k]) - t.begin());
    const Index below = std::clamp<Index>(after - 1, 0, t.size() - 2);
    const double part = std::clamp((at[k] - t[below]) / (t[below + 1] - t[below]), 0.0, 1.0);
    values[Index(k)] = part == 0   ? value(below)
                       : part == 1 ? value(below + 1)
                                   : (1 - part) * value(below) + part * value(below + 1);
  }
  return values;
}

}  // namespace bromwich::app
