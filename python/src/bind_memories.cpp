// Elements with memory: the Python layer states them as lists of dicts, which it has checked for their keys.

#include "answer.hpp"
#include "arrays.hpp"
#include "core/base/error.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace bromwich::python {
namespace {

class Statement {
 public:
  Statement(Model& model, const ConditionReader& conditions) : model_(model), conditions_(conditions) {}

  Memory memory(const nb::dict& given, const std::string& name) {
    Memory memory;
    memory.name = nb::cast<std::string>(given["name"]);
    memory.start = nb::cast<std::string>(given["start"]);
    for (const nb::handle one : nb::cast<nb::list>(given["modes"])) {
      const auto mode_given = nb::cast<nb::dict>(one);
      memory.modes.push_back(mode(mode_given, name + "." + nb::cast<std::string>(mode_given["name"])));
    }
    return memory;
  }

 private:
  Memory::Mode mode(const nb::dict& given, const std::string& name) {
    Memory::Mode mode;
    mode.name = nb::cast<std::string>(given["name"]);
    mode.f = source(given, "f");
    mode.g = source(given, "g");
    for (const auto& [key, matrix] : {std::pair("A", &mode.A), {"B", &mode.B}, {"N", &mode.N}, {"M", &mode.M}})
      if (given.contains(key)) *matrix = as_matrix(nb::cast<Array2>(given[key]));
    for (const nb::handle one : nb::cast<nb::list>(given["leave"]))
      mode.leave.push_back(leave(nb::cast<nb::dict>(one), name + ".leave"));
    return mode;
  }

  Memory::Leave leave(const nb::dict& given, const std::string& name) {
    Memory::Leave leave;
    leave.to = nb::cast<std::string>(given["to"]);
    for (const auto& text : nb::cast<std::vector<std::string>>(given["when"])) {
      ReadCondition read = conditions_.read(text, name + ".when");
      note(read.breakpoints, read.breakpoints_are_all);
      leave.when.push_back(std::move(read.condition));
    }
    for (const auto& [state, value] : nb::cast<std::map<std::string, double>>(given["set"])) {
      const Index i = conditions_.state(state);
      if (i < 0)
        throw Error(name + ".set", "names '" + state + "', which is no state", "use names of states, or x0, x1");
      leave.set.push_back({i, value});
    }
    return leave;
  }

  TimeFunction source(const nb::dict& given, const char* key) {
    if (!given.contains(key)) return {};
    const auto& source = nb::cast<const Source&>(given[key]);
    model_.callables.insert(model_.callables.end(), source.callables.begin(), source.callables.end());
    if (source.forget) model_.forget.push_back(source.forget);
    note(source.breakpoints, source.breakpoints_are_all);
    return source.function;
  }

  void note(const std::vector<double>& times, bool all) {
    Scene& scene = model_.scene;
    std::vector<double> inside;
    for (const double t : times)
      if (t >= 0 && t <= scene.T) inside.push_back(t);
    scene.breakpoints = merged(scene.breakpoints, inside);
    scene.breakpoints_are_all = scene.breakpoints_are_all && all;
  }

  Model& model_;
  const ConditionReader& conditions_;
};

nb::list memories_of(const Model& model) {
  nb::list all;
  for (const Memory& memory : model.scene.memories) {
    std::vector<std::string> modes;
    for (const Memory::Mode& mode : memory.modes) modes.push_back(mode.name);
    all.append(nb::make_tuple(memory.name, modes, memory.start.empty() ? modes.front() : memory.start));
  }
  return all;
}

}  // namespace

void bind_memories(nb::module_& m) {
  m.def(
      "set_memories",
      [](Model& model, const nb::list& given, const std::vector<std::string>& x, const std::vector<std::string>& y,
         const std::map<std::string, double>& parameters) {
        Scene& scene = model.scene;
        std::vector<std::string> names;
        for (const nb::handle one : given) names.push_back(nb::cast<std::string>(nb::cast<nb::dict>(one)["name"]));
        const ConditionReader conditions(scene.states(), x, scene.constraints(), y, names, parameters, scene.T);
        Statement statement(model, conditions);
        std::vector<Memory> memories;
        for (const nb::handle one : given) {
          const auto memory = nb::cast<nb::dict>(one);
          memories.push_back(statement.memory(memory, "memory." + nb::cast<std::string>(memory["name"])));
        }
        scene.memories = std::move(memories);
        scene.validate();
      },
      nb::arg("model"), nb::arg("memories"), nb::arg("x"), nb::arg("y"), nb::arg("parameters"));
  m.def("memories_of", &memories_of, nb::arg("model"), "Name, modes and the first mode of each.");
  m.def(
      "modes_of", [](nb::handle_t<Answer> self) { return view(nb::cast<const Answer&>(self).result.modes, self); },
      nb::arg("answer"));
  m.def(
      "mode_changes_of",
      [](const Answer& answer) {
        nb::list all;
        for (const ModeChange& c : answer.result.mode_changes) all.append(nb::make_tuple(c.t, c.memory, c.from, c.to));
        return all;
      },
      nb::arg("answer"));
}

}  // namespace bromwich::python
