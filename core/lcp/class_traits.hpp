#pragma once
// The classes of complementarity matrices, and what a method needs to know of one.
//
// Methods, backends and stages use these properties and never the name of a class. So a new class is one line of
// `lcp_class_table` and its test in core/lcp/lcp_class.cpp.

#include "bromwich/lcp.hpp"

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

namespace bromwich {

/// The answers of one class. At most one of the three ways to a solution holds.
struct LcpClassTraits {
  LcpClass lcp_class;
  const char* name;          ///< in files, in Python and in texts
  bool has_one_solution;     ///< for every q
  bool selects_least;        ///< the least of all solutions is wanted: y <= every other one, entry by entry
  bool selects_least_norm;   ///< the solutions form a convex set; the one of least norm is wanted
  bool in_schur_complement;  ///< Schur complements of principal blocks are of the class, too
};

inline constexpr std::array<LcpClassTraits, 5> lcp_class_table{{
    {LcpClass::automatic, "auto", false, false, false, false},
    {LcpClass::P, "P", true, false, false, true},
    {LcpClass::Z, "Z", false, true, false, false},
    {LcpClass::PSD, "PSD", false, false, true, true},
    {LcpClass::unknown, "unknown", false, false, false, false},
}};

constexpr const LcpClassTraits& traits(LcpClass c) { return lcp_class_table[std::size_t(c)]; }

static_assert([] {
  for (const LcpClassTraits& t : lcp_class_table)
    if (&traits(t.lcp_class) != &t || int(t.has_one_solution) + int(t.selects_least) + int(t.selects_least_norm) > 1)
      return false;
  return true;
}());

/// Exactly one solution for every q.
constexpr bool has_one_solution(LcpClass c) { return traits(c).has_one_solution; }

/// The least solution is wanted where there are several.
constexpr bool selects_least(LcpClass c) { return traits(c).selects_least; }

/// The solution of least norm is wanted where there are several.
constexpr bool selects_least_norm(LcpClass c) { return traits(c).selects_least_norm; }

/// The class says which solution is wanted.
constexpr bool selects_one(LcpClass c) { return has_one_solution(c) || selects_least(c) || selects_least_norm(c); }

/// The wanted solution depends on q continuously; one of least norm need not (M = 0).
constexpr bool is_continuous(LcpClass c) { return has_one_solution(c) || selects_least(c); }

/// The solutions form a convex set, so that two different ones have others between them.
constexpr bool has_convex_solutions(LcpClass c) { return has_one_solution(c) || selects_least_norm(c); }

constexpr bool is_stated(LcpClass c) { return c != LcpClass::automatic; }

constexpr const char* to_string(LcpClass c) { return traits(c).name; }

/// The class of this name if a user may state it: any but `unknown`.
constexpr std::optional<LcpClass> lcp_class_named(std::string_view name) {
  for (const LcpClassTraits& t : lcp_class_table)
    if (name == t.name && t.lcp_class != LcpClass::unknown) return t.lcp_class;
  return std::nullopt;
}

}  // namespace bromwich
