#pragma once

namespace bromwich {

/// The data of a scene that have changed since the last solve.
struct Changes {
  bool x0 = true;
  bool sources = true;  ///< f, g or their breakpoints

  bool any() const { return x0 || sources; }
  void add(const Changes& more) { x0 = x0 || more.x0, sources = sources || more.sources; }
};

inline constexpr Changes no_changes{false, false};

}  // namespace bromwich
