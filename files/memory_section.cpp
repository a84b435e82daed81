#include "files/memory_section.hpp"

#include "core/base/error.hpp"
#include "core/scene/memory.hpp"
#include "files/condition.hpp"
#include "files/reference_section.hpp"
#include "files/scene_matrices.hpp"
#include "files/words.hpp"

#include <fmt/format.h>

#include <set>

namespace bromwich {

namespace {

/// One memory of the file.
class Reader {
 public:
  Reader(const Section& section, Draft& draft, const std::vector<std::string>& memories)
      : section_(section),
        draft_(draft),
        m_(draft.scene.states()),
        n_(draft.scene.constraints()),
        names_(m_, draft.scene.names.x, n_, draft.scene.names.y, memories) {}

  Memory read() const {
    Memory memory;
    memory.name = section_.text("name", "");
    if (memory.name.empty())
      throw Error(section_.where("name"), "is missing", "give the memory a name, such as name = \"heater\"");
    const std::vector<Section> modes = section_.tables("modes", {"f", "g", "A", "B", "N", "M", "leave"});
    std::vector<std::string> names;
    for (const Section& mode : modes) names.push_back(mode.last_name());
    if (names.empty())
      throw Error(section_.where("modes"), "has no mode", "add a section [memory.modes.NAME] for each");
    memory.start = section_.has("start") ? section_.word("start", names) : "";
    for (std::size_t i = 0; i < modes.size(); ++i) memory.modes.push_back(mode(modes[i], names[i], names));
    return memory;
  }

 private:
  Memory::Mode mode(const Section& section, const std::string& name, const std::vector<std::string>& all) const {
    Memory::Mode mode;
    mode.name = name;
    mode.f = source(section, "f", m_, "one per state");
    mode.g = source(section, "g", n_, "one per constraint");
    for (const auto& [key, matrix, rows, columns] :
         {std::tuple("A", &mode.A, m_, m_), {"B", &mode.B, m_, n_}, {"N", &mode.N, n_, m_}, {"M", &mode.M, n_, n_}})
      if (section.has(key)) {
        *matrix = dense_value(section.matrix(key, rows, columns), section.where(key));
        if (matrix->rows() != rows || matrix->cols() != columns)
          throw Error(section.where(key), fmt::format("is {} x {}", matrix->rows(), matrix->cols()),
                      fmt::format("make it that of the scene, {} x {}", rows, columns));
      }
    if (section.has("leave"))
      for (const Section& one : section.tables("leave", {"to", "when", "set"})) mode.leave.push_back(leave(one, all));
    return mode;
  }

  TimeFunction source(const Section& section, const char* key, Index size, const char* meaning) const {
    const FunctionValue value = section.function(key, draft_.scene.T, size);
    require_entries(value, size, section.where(key), meaning);
    draft_.note(value.switches);
    return value.function;
  }

  Memory::Leave leave(const Section& section, const std::vector<std::string>& modes) const {
    Memory::Leave leave;
    if (!section.has("to")) throw Error(section.where("to"), "is missing", "give the mode that follows: to = \"...\"");
    leave.to = section.word("to", modes);
    for (const std::string& text : section.one_or_more_texts("when")) {
      SwitchTimes switches;
      leave.when.push_back(
          read_condition(text, names_, section.expressions_of_file(), draft_.scene.T, section.where("when"), switches));
      draft_.note(switches);
    }
    if (!section.has("set")) return leave;
    std::vector<std::string> states;
    for (const auto& [name, number] : names_.variables)
      if (Index(number) < m_) states.push_back(name);
    const Section set = section.table("set", states);
    for (const std::string& state : set.keys())
      leave.set.push_back({Index(names_.variables.at(state)), set.number(state)});
    return leave;
  }

  const Section& section_;
  Draft& draft_;
  const Index m_, n_;
  const ConditionNames names_;
};

}  // namespace

void add_memories(const Sections& s, Draft& draft) {
  std::vector<std::string> all;
  for (const Section& section : s.memories) all.push_back(section.text("name", ""));
  std::set<std::string> names;
  for (const Section& section : s.memories) {
    if (draft.mechanism)
      throw Error(section.where("modes"), "is given with [structure]",
                  "write the motion as [dynamics] and [complementarity]");
    if (!draft.scene.dynamics->small_state() || !draft.scene.free_rows.empty())
      throw Error(section.where("modes"), "is given for a scene without dense matrices, or with free rows",
                  "write A, B and N as lists of rows");
    draft.scene.memories.push_back(Reader(section, draft, all).read());
    if (const std::string& name = draft.scene.memories.back().name; !names.insert(name).second)
      throw Error(section.where("name"), fmt::format("'{}' is taken", name), "give every memory a name of its own");
  }
}

}  // namespace bromwich
