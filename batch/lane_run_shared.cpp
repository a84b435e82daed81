#include "batch/lane_run_of.hpp"

namespace bromwich {

template void run_lanes<double>(LaneState&);

}  // namespace bromwich
