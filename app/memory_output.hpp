#pragma once
// What the command says of elements with memory.

#include "app/output_json.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// "heater: off (to on), on (to off); begins with off"
std::vector<std::string> memory_facts(const Scene&);
/// "heater 7 changes, on at T"
std::string memory_line(const Scene&, const Result&);

/// Names, modes, start.
Json memories_json(const Scene&);
/// The same with the changes of a result, and the modes that it begins in.
Json memories_json(const Scene&, const Result&);

}  // namespace bromwich::app
