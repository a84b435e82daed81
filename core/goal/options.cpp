#include "core/goal/options.hpp"

namespace bromwich {

const char* to_string(CellWeights weights) {
  switch (weights) {
    case CellWeights::local:
      return "local";
    case CellWeights::interpolated:
      return "interpolated";
    case CellWeights::global:
      break;
  }
  return "global";
}

const char* to_string(Refinement refinement) { return refinement == Refinement::division ? "division" : "bisection"; }

}  // namespace bromwich
