#pragma once
// What there is to say of a result beside its status, as codes with numbers. `sentence` alone makes words of them.

#include "result.hpp"

#include <cmath>
#include <string>

namespace bromwich {

/// What there is to say of a result beside its status.
enum class NoticeCode : char {
  // What is wrong with the rows.
  error_of_steps,      ///< size: of x; other: of y, or of its mean with `of_mean`
  unresolved_sources,  ///< f or g inside steps, around t; size: missed of a source, NaN if unknown
  undivided_jumps,     ///< g jumps inside steps, where the method has order 1
  first_order,         ///< implicit Euler in the place of a method of higher order
  unlocated_switches,  ///< method galerkin; count: of them
  blind_input,         ///< method goal; count: steps at whose points the input nearly vanishes
  // How far it can be known.
  rounding,       ///< size: error of data that magnify it
  rounding_of_y,  ///< y is so small beside the terms of w that rounding decides its sign
  mass_matrix,    ///< nearly singular; size: reciprocal condition; other: change by rounding of its entries
  boundary,       ///< the boundary condition; size: reciprocal condition
  // Whether it is the only solution.
  several_starts,  ///< other states fulfil the boundary condition
  other_start,     ///< y(0)
  other_y,         ///< around t, with the same state
  other_state,     ///< around t
  may_be_others,   ///< not known
  not_monotone,    ///< size: smallest eigenvalue of the symmetric part, NaN if it was not looked at
  free_unknowns,   ///< not determined
  // Why there is no result.
  too_many_steps,  ///< more operations than were allowed
};

/// A code with its numbers.
struct Notice {
  NoticeCode code;
  double size = NAN,
         other = NAN;  ///< relative
  double t = NAN;
  Index count = 0;
  bool of_mean = false;
};

std::string sentence(const Notice&);

/// Adds its sentence to Result::warning.
void tell(Result&, const Notice&);

}  // namespace bromwich
