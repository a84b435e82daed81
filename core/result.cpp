#include "core/result.hpp"

namespace bromwich {

const char* to_string(Status status) {
  switch (status) {
    case Status::solved:
      return "solved";
    case Status::tolerance_not_met:
      return "tolerance_not_met";
    case Status::infeasible:
      return "infeasible";
    case Status::unsupported:
      return "unsupported";
    case Status::nonfinite:
      return "nonfinite";
    case Status::interrupted:
      return "interrupted";
  }
  return "unknown";
}

}  // namespace bromwich
