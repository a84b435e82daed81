#include "core/base/error.hpp"
#include "sources.hpp"

namespace bromwich::python {

Source expression_source(const std::vector<std::string>&, const std::map<std::string, double>&, double,
                         const std::string& name) {
  throw Error(name, "is an expression, and this build has no reader for them",
              "install libtomlplusplus-dev and libmuparser-dev and build again, or give a function");
}

}  // namespace bromwich::python
