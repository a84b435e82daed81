// For builds without spdlog.

#include "app/log.hpp"
#include "core/base/error.hpp"

namespace bromwich::app {

Log make_log(const std::string& level, std::function<void()>) {
  if (level == "off") return {};
  throw Error("--log-level", "found '" + level + "' but spdlog was not found when this was built",
              "leave it out, or install libspdlog-dev and build again");
}

}  // namespace bromwich::app
