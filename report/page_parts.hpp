#pragma once
// The parts of a page, each as HTML; empty where there is nothing to say.

#include "report/page.hpp"

namespace bromwich::report {

std::string outcome_part(const Report&);      ///< status and warning, in words
std::string facts_part(const Report&);        ///< what was solved, and how
std::string certificate_part(const Report&);  ///< what was checked
std::string contacts_part(const Report&);     ///< bars, losses and phase planes of structures
std::string curves_part(const Report&);       ///< y, w, states and other columns over time
std::string active_part(const Report&);       ///< when constraints are active
std::string convergence_part(const Report&);  ///< of sweeps, cycles, or grids
std::string error_part(const Report&);        ///< parts of the error and the tolerance
std::string time_part(const Report&);         ///< where the time went, and memory

}  // namespace bromwich::report
