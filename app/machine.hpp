#pragma once
// What the machine is, for the provenance of a measurement and to refuse what cannot fit.

#include <string>

namespace bromwich::app {

std::string cpu_model();  ///< from /proc/cpuinfo, or "unknown"
int cpu_cores();          ///< cores that this process may use
double memory_bytes();  ///< physical memory, or the limit of the control group or of the process (ulimit) where smaller
std::string utc_now();  ///< "2026-01-31T12:00:00Z"

}  // namespace bromwich::app
