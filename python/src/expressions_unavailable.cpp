#include "core/base/error.hpp"
#include "sources.hpp"

namespace bromwich::python {

Source expression_source(const std::vector<std::string>&, const std::map<std::string, double>&, double,
                         const std::string& name) {
  throw Error(name, "is an expression, and this build has no reader for them",
              "install libtomlplusplus-dev and libmuparser-dev and build again, or give a function");
}

struct ConditionReader::Parts {};

ConditionReader::ConditionReader(Index, const std::vector<std::string>&, Index, const std::vector<std::string>&,
                                 const std::vector<std::string>&, const std::map<std::string, double>&, double) {
  throw Error("memory", "has conditions, and this build has no reader for them",
              "install libtomlplusplus-dev and libmuparser-dev and build again");
}
ReadCondition ConditionReader::read(const std::string&, const std::string&) const { return {}; }
Index ConditionReader::state(const std::string&) const { return -1; }

}  // namespace bromwich::python
