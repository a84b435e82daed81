#pragma once

#include "../base/types.hpp"
#include "bromwich/result.hpp"
#include "method.hpp"

namespace bromwich {

/// The result is one of implicit Euler: of that method, or of cycles in w without stages.
inline bool by_euler(Method method, const Result& result) {
  return method == Method::euler || (result.form == "dual" && result.continuous);
}
inline bool by_euler(const Result& result) { return by_euler(result.method, result); }

/// The result for a scene with an idle constraint (core/scene/port_hamiltonian.hpp), with y = 0.
Result with_idle_constraint(Result);

/// Appends a sentence to Result::warning unless it is already there.
void add_warning(Result&, const std::string& sentence);

}  // namespace bromwich
