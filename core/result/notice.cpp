#include "core/result/notice.hpp"

#include "core/base/text.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr double least_part = 0.02;  ///< of a component: an error that is named beside a larger one

std::string percent(const char* what, double size) {
  if (!std::isfinite(size)) return std::string(what) + " by an unknown part";
  return text(size < 0.1 ? "%s by about %.1f %%" : "%s by about %.0f %%", what, 100 * size);
}

std::string error_of_steps(const Notice& n) {
  std::string parts;
  for (const auto& [what, size] : {std::pair("x", n.size), {n.of_mean ? "the mean of y" : "y", n.other}})
    if (size > least_part) parts += (parts.empty() ? "" : ", ") + percent(what, size);
  return "with these steps the result is off: " + parts + "; use more steps or a tolerance";
}

std::string unresolved_sources(const Notice& n) {
  std::string where = std::isnan(n.t) ? "" : text(" (around t = %.6g)", n.t);
  if (!std::isnan(n.size)) where += text(", by up to %.0f %% of its size", 100 * n.size);
  return "f or g changes too fast for these steps, inside of some" + where + ": use more steps";
}

std::string mass_matrix(const Notice& n) {
  return text("the mass matrix E is nearly singular (reciprocal condition %.1e): ", n.size) +
         (std::isfinite(n.other) ? text("rounding of its entries alone changes the result by %.1e", n.other)
                                 : "with its entries rounded otherwise the scene is not solved alike") +
         "; state the nearly algebraic part as such, or in other variables";
}

std::string not_monotone(const Notice& n) {
  if (std::isnan(n.size)) return "whether the solution is the only one was not looked at: it has too many states";
  return text("uniqueness is not assured: smallest eigenvalue of the symmetric part %.2g", n.size);
}

}  // namespace

std::string sentence(const Notice& n) {
  switch (n.code) {
    case NoticeCode::error_of_steps:
      return error_of_steps(n);
    case NoticeCode::unresolved_sources:
      return unresolved_sources(n);
    case NoticeCode::undivided_jumps:
      return "g jumps inside steps, where this method has order 1: method march takes such steps in parts";
    case NoticeCode::first_order:
      return "y and w are those of implicit Euler, of order 1: the methods of higher order do not solve these steps";
    case NoticeCode::unlocated_switches:
      return text("%ld switch(es) not located: y jumps there or is active for no whole interval", long(n.count));
    case NoticeCode::blind_input:
      return text("the input nearly vanishes at all points where %ld steps look at it: use another number of steps",
                  long(n.count));
    case NoticeCode::rounding:
      return text("the error is about %.1e, of data that magnify rounding", n.size);
    case NoticeCode::rounding_of_y:
      return "y is so small beside the terms of w that rounding decides its sign";
    case NoticeCode::mass_matrix:
      return mass_matrix(n);
    case NoticeCode::boundary:
      return text("the boundary condition is ill-conditioned (reciprocal condition %.1e)", n.size);
    case NoticeCode::several_starts:
      return "other states fulfil the boundary condition too: E0 + ET D is singular, D the derivative of x(T) by x(0)";
    case NoticeCode::other_start:
      return "y(0) is not unique: the problem at t = 0 has another solution";
    case NoticeCode::other_y:
      return text("y is not unique: at t = %.6g another one goes with the same state", n.t);
    case NoticeCode::other_state:
      return text("the solution is not unique: at t = %.6g another one goes on, with another state", n.t);
    case NoticeCode::may_be_others:
      return "the problems of the steps are not known to have only one solution: there may be others";
    case NoticeCode::not_monotone:
      return not_monotone(n);
    case NoticeCode::too_many_steps:
      return "too many steps";
    case NoticeCode::free_unknowns:
      return "the free unknowns are not determined; theirs of least norm are given";
  }
  return "";
}

void tell(Result& result, const Notice& notice) { add_warning(result, sentence(notice)); }

}  // namespace bromwich
