#pragma once
// Properties of the machine, for the provenance of a measurement and to reject scenes that do not fit into memory.

#include <string>

namespace bromwich::app {

std::string cpu_model();  ///< from /proc/cpuinfo, or "unknown"
int cpu_cores();          ///< cores that this process may use
double memory_bytes();    ///< physical memory, or the limit of the control group or of the process (ulimit) if smaller
std::string utc_now();    ///< "2026-01-31T12:00:00Z"

}  // namespace bromwich::app
