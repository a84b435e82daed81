#pragma once
// Expressions of t as one function with an entry for each.

#include "core/base/time_function.hpp"
#include "core/catalogue/catalogue.hpp"

#include <string>
#include <utility>
#include <vector>

namespace bromwich {

/// Entries with a text have its value, others that of `constants`. The texts were checked before. The function may be
/// called from several threads at once.
TimeFunction time_vector(Vector constants, const std::vector<std::pair<Index, std::string>>& texts,
                         const ParameterValues&);

}  // namespace bromwich
